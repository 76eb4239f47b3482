//! Changes of bytes, of numbers in them, and of what is packed.

use std::io::{Read, Write};

use super::{LARGEST, csv};
use crate::draw::Draw;

const NUMBERS: [u64; 16] = [
    0,
    1,
    2,
    7,
    8,
    0x7f,
    0xff,
    0xffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x1_0000_0000,
    0x7fff_ffff_ffff_ffff,
    0x8000_0000_0000_0000,
    0xffff_ffff_ffff_fff8,
    u64::MAX,
];

/// One change.
pub fn change(bytes: &mut Vec<u8>, other: &[u8], draw: &mut Draw) {
    if bytes.is_empty() {
        bytes.push(draw.byte());
        return;
    }
    let place = draw.below(bytes.len());
    match draw.below(12) {
        0 => bytes[place] ^= 1 << draw.below(8),
        1 => bytes[place] = draw.byte(),
        2 => {
            let more: Vec<u8> = (0..draw.size(16)).map(|_| draw.byte()).collect();
            bytes.splice(place..place, more);
        }
        3 => {
            let end = (place + draw.size(64)).min(bytes.len());
            bytes.drain(place..end);
        }
        4 => bytes.truncate(place),
        5 => {
            let end = (place + draw.size(256)).min(bytes.len());
            let own = bytes[place..end].to_vec();
            let at = draw.below(bytes.len());
            bytes.splice(at..at, own);
        }
        6 if !other.is_empty() => {
            let from = draw.below(other.len());
            let to = (from + draw.size(512)).min(other.len());
            let end = if draw.one_in(2) { place } else { (place + to - from).min(bytes.len()) };
            bytes.splice(place..end, other[from..to].iter().copied());
        }
        7 => {
            let zero = draw.one_in(2);
            let end = (place + draw.size(64)).min(bytes.len());
            bytes[place..end].fill(if zero { 0 } else { 0xff });
        }
        // A length, a count or a place: of 1, 2, 4 or 8 bytes, at a multiple of its size or not.
        8..=11 => {
            let width = 1 << draw.below(4);
            let place = if draw.one_in(3) { place } else { place / width * width };
            let end = (place + width).min(bytes.len());
            let mut old = [0; 8];
            old[..end - place].copy_from_slice(&bytes[place..end]);
            let old = u64::from_le_bytes(old);
            let new = match draw.below(4) {
                0 => *draw.of_these(&NUMBERS),
                1 => old.wrapping_add(*draw.of_these(&NUMBERS)),
                2 => old.wrapping_mul(2 + draw.below(1000) as u64),
                _ => (bytes.len() as u64).wrapping_add(draw.below(16) as u64).wrapping_sub(8),
            };
            let new = if draw.one_in(8) { new.to_be_bytes() } else { new.to_le_bytes() };
            bytes[place..end].copy_from_slice(&new[..end - place]);
        }
        _ => {}
    }
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(bytes).and_then(|()| packed.finish()).unwrap_or_default()
}

pub fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(bytes).and_then(|()| packed.finish()).unwrap_or_default()
}

pub fn zstd(bytes: &[u8]) -> Vec<u8> {
    zstd::bulk::compress(bytes, 1).unwrap_or_default()
}

fn unpacked(reader: impl Read) -> Vec<u8> {
    let mut bytes = Vec::new();
    let _ = reader.take(LARGEST as u64).read_to_end(&mut bytes);
    bytes
}

/// A packed text, changed inside or outside, or one that unpacks to much more than it is.
pub fn of_packed_text(seed: &[u8], others: &[Vec<u8>], is_gzip: bool, draw: &mut Draw) -> Vec<u8> {
    let pack = |bytes: &[u8]| if is_gzip { gzip(bytes) } else { zstd(bytes) };
    if draw.one_in(3) {
        return super::of_bytes(seed, others, draw);
    }
    if draw.one_in(2000) {
        return pack(&bomb(draw));
    }
    let inner = if is_gzip {
        unpacked(flate2::read::MultiGzDecoder::new(seed))
    } else {
        zstd::stream::read::Decoder::new(seed).map(unpacked).unwrap_or_default()
    };
    let mut inner = csv::of(&inner, &[], draw);
    inner.truncate(1 << 14);
    let mut packed = pack(&inner);
    // A second member.
    if draw.one_in(10) {
        packed.extend(pack(b"1,2,3,4\n"));
    }
    packed
}

/// Much of little.
fn bomb(draw: &mut Draw) -> Vec<u8> {
    let row: &[u8] = draw.copy_of(&[&b"\0"[..], b"0,", b"1\n", b"t,q0,tau0\n0,0,0\n", b"\"", b"\"\n"]);
    row.iter().copied().cycle().take(80 << 20).collect()
}

/// A file of MATLAB, changed also within its packed elements.
pub fn of_matlab(seed: &[u8], others: &[Vec<u8>], draw: &mut Draw) -> Vec<u8> {
    if draw.one_in(3) || seed.len() < 136 {
        return super::of_bytes(seed, others, draw);
    }
    let mut file = seed[..128].to_vec();
    let mut rest = &seed[128..];
    let n_elements = draw.size(4);
    for _ in 0..n_elements {
        let Some((head, after)) = rest.split_at_checked(8) else { break };
        let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        let length = (word(4) as usize).min(after.len());
        let mut inner = match word(0) {
            15 => unpacked(flate2::read::ZlibDecoder::new(&after[..length])),
            _ => [head, &after[..length]].concat(),
        };
        let end = if word(0) == 15 { length } else { length.next_multiple_of(8).min(after.len()) };
        rest = &after[end..];
        if draw.one_in(400) {
            // A vector of bytes that were never in the file.
            inner = matlab_bytes(draw.size(100 << 20));
        } else {
            for _ in 0..draw.size(4) {
                change(&mut inner, draw.of_these(others).as_slice(), draw);
            }
        }
        let packed = if draw.one_in(2) || inner.len() > LARGEST { zlib(&inner) } else { Vec::new() };
        if packed.is_empty() {
            file.extend(inner);
        } else {
            file.extend(15u32.to_le_bytes());
            file.extend((packed.len() as u32).to_le_bytes());
            file.extend(packed);
        }
    }
    file.extend(rest);
    file
}

/// An element: a variable of so many zeros of 8 bits.
fn matlab_bytes(count: usize) -> Vec<u8> {
    let mut content = Vec::new();
    let mut part = |kind: u32, bytes: &[u8]| {
        content.extend(kind.to_le_bytes());
        content.extend((bytes.len() as u32).to_le_bytes());
        content.extend(bytes);
        content.resize(content.len().next_multiple_of(8), 0);
    };
    part(6, &[9, 0, 0, 0, 0, 0, 0, 0]);
    part(5, &[(count as u32).to_le_bytes(), 1u32.to_le_bytes()].concat());
    part(1, b"x");
    part(2, &vec![0; count]);
    let mut element = 14u32.to_le_bytes().to_vec();
    element.extend((content.len() as u32).to_le_bytes());
    element.extend(content);
    element
}

/// A file of MCAP: some of its records, changed, in a chunk or not.
pub fn of_mcap(seed: &[u8], others: &[Vec<u8>], draw: &mut Draw) -> Vec<u8> {
    if draw.one_in(3) || seed.len() < 8 {
        return super::of_bytes(seed, others, draw);
    }
    let mut records: Vec<(u8, Vec<u8>)> = Vec::new();
    take_records(&seed[8..], &mut records);
    let mut file = seed[..8].to_vec();
    records.truncate(8 + draw.size(100));
    for _ in 0..draw.size(6) {
        let at = draw.below(records.len());
        let with = draw.below(records.len());
        match (draw.below(5), records.get_mut(at)) {
            (0, Some(_)) => drop(records.remove(at)),
            (1, Some(own)) => {
                let copy = own.clone();
                records.insert(with, copy);
            }
            (2, Some(_)) => records.swap(at, with),
            (_, Some((_, own))) => change(own, draw.of_these(others).as_slice(), draw),
            (_, None) => {}
        }
    }
    if draw.one_in(2000) {
        let packed = zstd(&bomb(draw));
        file.extend(record(6, &chunk("zstd", &packed)));
    }
    let mut inner = Vec::new();
    for (kind, own) in &records {
        inner.extend(record(*kind, own));
    }
    match draw.below(3) {
        0 => file.extend(inner),
        1 => file.extend(record(6, &chunk("", &inner))),
        _ => file.extend(record(6, &chunk("zstd", &zstd(&inner)))),
    }
    file.extend(record(15, &[0; 4]));
    file
}

fn record(kind: u8, content: &[u8]) -> Vec<u8> {
    [&[kind][..], &(content.len() as u64).to_le_bytes(), content].concat()
}

fn chunk(compression: &str, packed: &[u8]) -> Vec<u8> {
    let mut chunk = vec![0; 28];
    chunk.extend((compression.len() as u32).to_le_bytes());
    chunk.extend(compression.bytes());
    chunk.extend((packed.len() as u64).to_le_bytes());
    chunk.extend(packed);
    chunk
}

/// Schemas, channels and messages, also those in chunks.
fn take_records(mut bytes: &[u8], records: &mut Vec<(u8, Vec<u8>)>) {
    while let Some((head, rest)) = bytes.split_at_checked(9) {
        let length = u64::from_le_bytes([1, 2, 3, 4, 5, 6, 7, 8].map(|at| head[at])) as usize;
        let Some((content, after)) = rest.split_at_checked(length) else { return };
        bytes = after;
        match head[0] {
            6 => {
                let name = content.get(28).map_or(0, |length| usize::from(*length));
                let packed = content.get(32 + name + 8..).unwrap_or_default();
                match content.get(32..32 + name) {
                    Some(b"zstd") => {
                        let inner = zstd::stream::read::Decoder::new(packed).map(unpacked).unwrap_or_default();
                        take_records(&inner, records);
                    }
                    Some(b"") => take_records(packed, records),
                    _ => {}
                }
            }
            3..=5 => records.push((head[0], content.to_vec())),
            _ => {}
        }
    }
}
