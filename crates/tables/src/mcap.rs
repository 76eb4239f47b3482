//! MCAP: what its messages about joints say, `sensor_msgs/JointState` of ROS 2 (CDR) or the same as JSON ([`joint_state`]), one
//! column for each number of each joint: `/joint_states.position[elbow]`, and `t`, seconds since the first row.
//!
//! Topics with other rates are joined ([`join`]). Layout by the MCAP specification, version 0: after eight bytes records of a
//! type, a length and content; a chunk holds further records, compressed or not.

mod join;
mod joint_state;

use std::{
    collections::BTreeMap,
    io::{BufReader, Read, Seek, SeekFrom},
};

use crate::{Named, Remark, TableError, unpacked};
use join::Stream;
use joint_state::{Encoding, JointState};

const BEGINNING: usize = 8;

const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
const FOOTER: u8 = 0x02;
const DATA_END: u8 = 0x0f;

/// The columns, and how they were joined.
pub(crate) fn columns(file: impl Read + Seek, most: u64) -> Result<(Vec<Named>, Vec<Remark>), TableError> {
    let mut file = BufReader::new(file);
    let length = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(BEGINNING as u64))?;
    let mut log = Log { left: most, ..Log::default() };
    let mut place = BEGINNING as u64;
    loop {
        let mut start = [0; 9];
        file.read_exact(&mut start).map_err(|_| cut(place))?;
        let (kind, size) = (start[0], u64::from_le_bytes([1, 2, 3, 4, 5, 6, 7, 8].map(|byte| start[byte])));
        place += 9;
        if size > length.saturating_sub(place) {
            return Err(cut(place));
        }
        match kind {
            DATA_END | FOOTER => break,
            SCHEMA | CHANNEL | MESSAGE | CHUNK => {
                let mut content = Vec::new();
                Read::by_ref(&mut file).take(size).read_to_end(&mut content)?;
                let record = Bytes(&content);
                let whole = if kind == CHUNK { log.chunk(record)? } else { log.record(kind, record) };
                whole.ok_or_else(|| cut(place))?;
            }
            // The size is at most that of the file.
            _ => file.seek_relative(size as i64)?,
        }
        place += size;
    }
    if let Some(topic) = log.damaged {
        return Err(TableError::Unreadable(format!("a message of {topic} is no joint state as its schema says")));
    }
    join::table(log.streams.into_values().collect())
}

fn cut(place: u64) -> TableError {
    TableError::Unreadable(format!("it is damaged or cut at byte {place}; `mcap recover` keeps what can be read"))
}

/// Bytes that are read from the front.
#[derive(Clone, Copy)]
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let (own, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(own)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    fn string(&mut self) -> Option<String> {
        let length = self.u32()? as usize;
        String::from_utf8(self.take(length)?.to_vec()).ok()
    }
}

/// What was read so far.
#[derive(Default)]
struct Log {
    /// Name of each schema.
    schemas: BTreeMap<u16, String>,
    /// Topic and encoding of each channel with joint states.
    channels: BTreeMap<u16, (String, Encoding)>,
    /// By topic and names of the joints: one topic may hold the states of several machines.
    streams: BTreeMap<(String, Vec<String>), Stream>,
    /// A topic with a message that cannot be read.
    damaged: Option<String>,
    /// Bytes that may still be unpacked.
    left: u64,
}

impl Log {
    /// Reads a record; `None` where it is cut.
    fn record(&mut self, kind: u8, mut record: Bytes<'_>) -> Option<()> {
        match kind {
            SCHEMA => {
                let number = record.u16()?;
                self.schemas.insert(number, record.string()?);
            }
            CHANNEL => {
                let (number, schema) = (record.u16()?, record.u16()?);
                let (topic, encoding) = (record.string()?, record.string()?);
                let schema = self.schemas.get(&schema).map_or("", String::as_str);
                if let Some(encoding) = Encoding::of(&encoding, schema) {
                    self.channels.insert(number, (topic, encoding));
                }
            }
            MESSAGE => {
                let channel = record.u16()?;
                let (_sequence, logged, _published) = (record.u32()?, record.u64()?, record.u64()?);
                let Some((topic, encoding)) = self.channels.get(&channel) else { return Some(()) };
                match encoding.read(record.0) {
                    Some(JointState { names, .. }) if names.is_empty() => {}
                    Some(state) => {
                        let key = (topic.clone(), state.names.clone());
                        let stream = self.streams.entry(key).or_insert_with(|| Stream::new(topic));
                        stream.push(logged, state);
                    }
                    // Any JSON may be about anything.
                    None if *encoding == Encoding::Json => {}
                    None => self.damaged = Some(topic.clone()),
                }
            }
            _ => {}
        }
        Some(())
    }

    /// Reads the records of a chunk; `None` where it is cut.
    fn chunk(&mut self, mut chunk: Bytes<'_>) -> Result<Option<()>, TableError> {
        let Some((compression, packed)) = (|| {
            let _times = (chunk.u64()?, chunk.u64()?);
            let _unpacked = (chunk.u64()?, chunk.u32()?);
            let compression = chunk.string()?;
            let length = usize::try_from(chunk.u64()?).ok()?;
            Some((compression, chunk.take(length)?))
        })() else {
            return Ok(None);
        };
        let unpacked;
        let records = match compression.as_str() {
            "" => packed,
            "zstd" => {
                unpacked = unpacked::zstd(packed, self.left)?;
                self.left -= unpacked.len() as u64;
                &unpacked
            }
            "lz4" => {
                unpacked = unpacked::whole(lz4_flex::frame::FrameDecoder::new(packed), self.left)?;
                self.left -= unpacked.len() as u64;
                &unpacked
            }
            other => {
                return Err(TableError::Unreadable(format!(
                    "it is compressed by `{other}`; expected zstd, lz4 or nothing"
                )));
            }
        };
        let mut records = Bytes(records);
        while !records.0.is_empty() {
            let whole = (|| {
                let [kind] = records.array()?;
                let length = usize::try_from(records.u64()?).ok()?;
                self.record(kind, Bytes(records.take(length)?))
            })();
            if whole.is_none() {
                return Ok(None);
            }
        }
        Ok(Some(()))
    }
}
