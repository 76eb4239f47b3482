//! Text that is compressed: gzip, of one or more members, and Zstandard.

use std::io::Read;

use crate::TableError;

pub(crate) fn gzip(file: impl Read, most: u64) -> Result<Vec<u8>, TableError> {
    whole(flate2::read::MultiGzDecoder::new(file), most)
}

pub(crate) fn zstd(file: impl Read, most: u64) -> Result<Vec<u8>, TableError> {
    whole(zstd::stream::read::Decoder::new(file)?, most)
}

/// What a reader unpacks, if it is no more than `most` bytes.
pub(crate) fn whole(reader: impl Read, most: u64) -> Result<Vec<u8>, TableError> {
    let mut bytes = Vec::new();
    let unpacked = reader.take(most + 1).read_to_end(&mut bytes);
    unpacked
        .map_err(|error| TableError::Unreadable(format!("it cannot be unpacked ({error}): it is damaged or cut")))?;
    if bytes.len() as u64 > most {
        return Err(TableError::Unreadable(format!("it holds more than {most} bytes, unpacked; part it")));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_more_is_unpacked_than_may_be() {
        assert_eq!(whole(&b"1234"[..], 4).unwrap(), b"1234");
        assert!(whole(&b"12345"[..], 4).unwrap_err().to_string().contains("more than 4 bytes"));
    }
}
