//! Streams of messages as one table.
//!
//! The stream with the most columns is the clock (of equals the one with the most messages): its messages are the rows. At each
//! of them another stream's positions lie on the straight line between the messages before and after, since a joint moves on;
//! velocities and efforts are those of the message before, since a command holds until the next. Rows before another stream's
//! first message, or after its last where it has positions, are left out.

use super::joint_state::{FIELDS, JointState};
use crate::{NOTHING, Named, Remark, TableError};

const POSITION: usize = 0;

/// Messages of one topic about the same joints.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stream {
    topic: String,
    /// When it was logged (ns), and what it says.
    messages: Vec<(u64, JointState)>,
}

impl Stream {
    pub fn new(topic: &str) -> Self {
        Self { topic: topic.to_owned(), messages: Vec::new() }
    }

    pub fn push(&mut self, logged: u64, state: JointState) {
        self.messages.push((logged, state));
    }

    /// Fields that say something in some message.
    fn fields(&self) -> Vec<usize> {
        let says = |field: &usize| self.messages.iter().any(|(_, state)| !state.values[*field].is_empty());
        (0..FIELDS.len()).filter(says).collect()
    }

    fn n_joints(&self) -> usize {
        self.messages.first().map_or(0, |(_, state)| state.names.len())
    }

    fn has_positions(&self) -> bool {
        self.fields().contains(&POSITION)
    }

    fn number(&self, message: usize, field: usize, joint: usize) -> f64 {
        self.messages[message].1.values[field].get(joint).copied().unwrap_or(NOTHING)
    }

    /// Its number at a time of the clock, at which its message `before` is the last.
    fn at(&self, time: i64, times: &[i64], before: usize, field: usize, joint: usize) -> f64 {
        let own = self.number(before, field, joint);
        match times.get(before + 1) {
            Some(after) if field == POSITION && time > times[before] => {
                let share = (time - times[before]) as f64 / (after - times[before]) as f64;
                let next = self.number(before + 1, field, joint);
                if next.to_bits() == NOTHING.to_bits() { NOTHING } else { own + share * (next - own) }
            }
            _ => own,
        }
    }
}

/// The table of some streams.
pub(super) fn table(mut streams: Vec<Stream>) -> Result<(Vec<Named>, Vec<Remark>), TableError> {
    let mut remarks = Vec::new();
    streams.retain(|stream| !stream.fields().is_empty());
    // Stamps of machines and of the logger come from clocks that may differ.
    let is_stamped = streams.iter().flat_map(|stream| &stream.messages).all(|(_, state)| state.stamp != 0);
    if !is_stamped {
        remarks.push(Remark::TimeOfLogging);
    }
    let time = |(logged, state): &(u64, JointState)| if is_stamped { state.stamp } else { *logged as i64 };
    streams.iter_mut().for_each(|stream| stream.messages.sort_by_key(time));
    let size = |stream: &Stream| (stream.fields().len() * stream.n_joints(), stream.messages.len());
    // The first of equals: they are in the order of their topics.
    let Some(clock) = (0..streams.len()).rev().max_by_key(|place| size(&streams[*place])) else {
        let lacking = "it has no messages about joints; expected sensor_msgs/msg/JointState, as CDR or JSON";
        return Err(TableError::Unreadable(lacking.to_owned()));
    };
    let clock = streams.remove(clock);
    let times_of = |stream: &Stream| stream.messages.iter().map(time).collect::<Vec<i64>>();
    let others: Vec<(&Stream, Vec<i64>)> = streams.iter().map(|stream| (stream, times_of(stream))).collect();
    let is_covered = |time: &i64| {
        others.iter().all(|(stream, times)| {
            times.first().is_some_and(|first| first <= time)
                && (!stream.has_positions() || times.last().is_some_and(|last| last >= time))
        })
    };
    let all = times_of(&clock);
    let rows: Vec<usize> = (0..all.len()).filter(|row| is_covered(&all[*row])).collect();
    let Some(first) = rows.first().map(|row| all[*row]) else {
        let message =
            format!("its topics {} and {} were not logged at the same time", clock.topic, topics(&streams).join(", "));
        return Err(TableError::Unreadable(message));
    };
    let mut columns = vec![Named {
        name: "t".to_owned(),
        values: rows.iter().map(|row| all[*row].wrapping_sub(first) as f64 / 1e9).collect(),
    }];
    for field in clock.fields() {
        columns.extend((0..clock.n_joints()).map(|joint| Named {
            name: name(&clock, field, joint),
            values: rows.iter().map(|row| clock.number(*row, field, joint)).collect(),
        }));
    }
    for (stream, times) in &others {
        let before: Vec<usize> =
            rows.iter().map(|row| times.partition_point(|time| *time <= all[*row]).saturating_sub(1)).collect();
        for field in stream.fields() {
            columns.extend((0..stream.n_joints()).map(|joint| {
                let at = |(row, before): (&usize, &usize)| stream.at(all[*row], times, *before, field, joint);
                Named { name: name(stream, field, joint), values: rows.iter().zip(&before).map(at).collect() }
            }));
        }
    }
    if !streams.is_empty() {
        remarks.push(Remark::Joined { clock: clock.topic, others: topics(&streams), left_out: all.len() - rows.len() });
    }
    Ok((columns, remarks))
}

fn name(stream: &Stream, field: usize, joint: usize) -> String {
    format!("{}.{}[{}]", stream.topic, FIELDS[field], stream.messages[0].1.names[joint])
}

fn topics(streams: &[Stream]) -> Vec<String> {
    streams.iter().map(|stream| stream.topic.clone()).collect()
}
