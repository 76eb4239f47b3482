//! A message about joints: `sensor_msgs/JointState` as ROS 2 writes it (CDR), or its fields as JSON.

use serde_json::Value;

/// How messages of a channel are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Cdr,
    /// Whether it is about joints, each message tells.
    Json,
}

/// Fields of numbers.
pub(super) const FIELDS: [&str; 3] = ["position", "velocity", "effort"];

/// Bytes of a message of JSON that may be about joints; a value takes many times its text.
const LARGEST_JSON: usize = 1 << 20;

/// What a message says. A field that says nothing is empty, else it has one number a joint.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct JointState {
    /// The message's own time (ns since 1970); 0 where it has none.
    pub stamp: i64,
    pub names: Vec<String>,
    /// In the order of [`FIELDS`].
    pub values: [Vec<f64>; 3],
}

impl Encoding {
    /// The encoding of messages of this schema; `None` where they cannot be about joints.
    pub fn of(encoding: &str, schema: &str) -> Option<Self> {
        match encoding {
            "cdr" if matches!(schema, "sensor_msgs/msg/JointState" | "sensor_msgs/JointState") => Some(Self::Cdr),
            "json" => Some(Self::Json),
            _ => None,
        }
    }

    /// Reads a message; `None` where it is none.
    pub fn read(self, bytes: &[u8]) -> Option<JointState> {
        let state = match self {
            Self::Cdr => Cdr::of(bytes)?.joint_state()?,
            Self::Json if bytes.len() > LARGEST_JSON => return None,
            Self::Json => of_json(&serde_json::from_slice(bytes).ok()?)?,
        };
        let fits = |values: &Vec<f64>| values.is_empty() || values.len() == state.names.len();
        state.values.iter().all(fits).then_some(state)
    }
}

/// Bytes of OMG's CDR: each number stands at a multiple of its size, counted from behind the four bytes that say its byte order.
struct Cdr<'a> {
    bytes: &'a [u8],
    place: usize,
    is_little: bool,
}

impl<'a> Cdr<'a> {
    fn of(bytes: &'a [u8]) -> Option<Self> {
        let (kind, bytes) = bytes.split_at_checked(4)?;
        let is_little = match kind[..2] {
            [0, 0] => false,
            [0, 1] => true,
            _ => return None,
        };
        Some(Self { bytes, place: 0, is_little })
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let start = self.place.next_multiple_of(N);
        let mut own: [u8; N] = self.bytes.get(start..start + N)?.try_into().ok()?;
        self.place = start + N;
        if !self.is_little {
            own.reverse();
        }
        Some(own)
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    /// Ends with a zero, which its length counts.
    fn string(&mut self) -> Option<String> {
        let length = self.u32()? as usize;
        let text = self.bytes.get(self.place..self.place.checked_add(length)?)?;
        self.place += length;
        String::from_utf8(text.strip_suffix(&[0]).unwrap_or(text).to_vec()).ok()
    }

    /// Items of a sequence. Its length is only claimed: room is made as items come.
    fn sequence<T>(&mut self, mut item: impl FnMut(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        let length = self.u32()?;
        let mut items = Vec::new();
        for _ in 0..length {
            items.push(item(self)?);
        }
        Some(items)
    }

    fn joint_state(mut self) -> Option<JointState> {
        let (seconds, nanoseconds) = (self.u32()?.cast_signed(), self.u32()?);
        let _frame = self.string()?;
        let names = self.sequence(Self::string)?;
        let mut field = || self.sequence(|cdr| cdr.array().map(f64::from_le_bytes));
        let values = [field()?, field()?, field()?];
        Some(JointState { stamp: i64::from(seconds) * 1_000_000_000 + i64::from(nanoseconds), names, values })
    }
}

/// `{ header: { stamp }, name: [..], position: [..], .. }`, or `{ timestamp, joints: [{ name, position, .. }] }`.
fn of_json(message: &Value) -> Option<JointState> {
    let time = |value: &Value| {
        let part = |keys: [&str; 2]| keys.iter().find_map(|key| value.get(key)?.as_i64());
        part(["sec", "secs"])?.checked_mul(1_000_000_000)?.checked_add(part(["nsec", "nanosec"])?)
    };
    let stamp = message.get("header").and_then(|header| header.get("stamp")).or_else(|| message.get("timestamp"));
    let stamp = stamp.and_then(time).unwrap_or(0);
    let number = |value: &Value| value.as_f64();
    let text = |value: &Value| value.as_str().map(str::to_owned);
    if let Some(joints) = message.get("joints") {
        let joints = joints.as_array()?;
        let names = joints.iter().map(|joint| text(joint.get("name")?)).collect::<Option<_>>()?;
        // A field that some joints lack says nothing.
        let field = |key| joints.iter().map(|joint| number(joint.get(key)?)).collect::<Option<_>>().unwrap_or_default();
        return Some(JointState { stamp, names, values: FIELDS.map(field) });
    }
    let names = message.get("name")?.as_array()?.iter().map(text).collect::<Option<_>>()?;
    let field = |key| -> Option<Vec<f64>> {
        match message.get(key) {
            Some(values) => values.as_array()?.iter().map(number).collect(),
            None => Some(Vec::new()),
        }
    };
    let [position, velocity, effort] = FIELDS.map(field);
    Some(JointState { stamp, names, values: [position?, velocity?, effort?] })
}
