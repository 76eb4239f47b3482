//! MATLAB's files of version 7.3, which are HDF5 with a header before it: the same variables as in [`crate::matlab`], by the attributes
//! that MATLAB writes. An array lies there by rows, transposed: so its numbers follow each other column by column.

use hdf5_reader::{Datatype, Hdf5File, OpenOptions, error::Error, group::Group};

use crate::{
    Named, Remark, TableError,
    guarded::guarded,
    matlab::{DEEPEST, Variable, table},
};

/// The columns, and what was left out.
pub(crate) fn columns(bytes: Vec<u8>, most: u64) -> Result<(Vec<Named>, Vec<Remark>), TableError> {
    guarded(|| {
        let at_once = usize::try_from(most).unwrap_or(usize::MAX);
        let file = Hdf5File::from_vec_with_options(bytes, OpenOptions::default().with_max_read_bytes(at_once));
        let root = file.and_then(|file| file.root_group()).map_err(damaged)?;
        let mut found = Found { variables: Vec::new(), left: most };
        found.group(&root, "", DEEPEST)?;
        Ok(table(found.variables))
    })
}

fn damaged(error: Error) -> TableError {
    TableError::Unreadable(format!("it is no whole file of MATLAB 7.3 ({error})"))
}

struct Found {
    variables: Vec<Variable>,
    /// Bytes that further ones may fill.
    left: u64,
}

impl Found {
    /// Adds the numbers of a group: the file's variables, or the fields of a struct.
    fn group(&mut self, group: &Group, prefix: &str, deepest: usize) -> Result<(), TableError> {
        let (groups, datasets) = group.members().map_err(damaged)?;
        for dataset in &datasets {
            let class = dataset.attribute("MATLAB_class").and_then(|own| own.read_string()).unwrap_or_default();
            // Where sizes stand in place of numbers.
            let is_empty = dataset.attribute("MATLAB_empty").is_ok();
            if is_empty || matches!(class.as_str(), "char" | "cell" | "function_handle") {
                continue;
            }
            let Some(number) = number_of(dataset.dtype()) else { continue };
            let n_bytes = dataset.raw_byte_len().map_err(damaged)?;
            self.left = self.left.checked_sub(n_bytes as u64).ok_or_else(|| {
                TableError::Unreadable("its variables hold more bytes than may be unpacked; part it".to_owned())
            })?;
            let mut long: Vec<usize> = dataset.shape().iter().rev().map(|size| *size as usize).collect();
            if long.len() > 2 {
                long.retain(|size| *size != 1);
            }
            long.resize(long.len().max(2), 1);
            let [n_rows, n_columns] = long[..] else { continue };
            let raw = dataset.read_native_bytes().map_err(damaged)?;
            let values = number(&raw);
            if !values.is_empty() {
                self.variables.push(Variable {
                    name: format!("{prefix}{}", dataset.name()),
                    n_rows,
                    n_columns,
                    values,
                });
            }
        }
        // `#refs#` holds the parts of cells and of several structs; a sparse matrix its places.
        for inner in groups.iter().filter(|inner| !inner.name().starts_with('#') && deepest > 0) {
            if inner.attribute("MATLAB_sparse").is_err() {
                self.group(inner, &format!("{prefix}{}.", inner.name()), deepest - 1)?;
            }
        }
        Ok(())
    }
}

/// Numbers of bytes.
type Numbers = fn(&[u8]) -> Vec<f64>;

/// How bytes of this type, in the order of this machine, become numbers; `None` of what is no real number.
fn number_of(kind: &Datatype) -> Option<Numbers> {
    macro_rules! numbers {
        ($own:ty) => {
            |bytes| bytes.as_chunks().0.iter().map(|own| <$own>::from_ne_bytes(*own) as f64).collect()
        };
    }
    Some(match kind {
        Datatype::FloatingPoint { size: 8, .. } => numbers!(f64),
        Datatype::FloatingPoint { size: 4, .. } => numbers!(f32),
        Datatype::FixedPoint { size: 1, signed: true, .. } => numbers!(i8),
        Datatype::FixedPoint { size: 1, signed: false, .. } => numbers!(u8),
        Datatype::FixedPoint { size: 2, signed: true, .. } => numbers!(i16),
        Datatype::FixedPoint { size: 2, signed: false, .. } => numbers!(u16),
        Datatype::FixedPoint { size: 4, signed: true, .. } => numbers!(i32),
        Datatype::FixedPoint { size: 4, signed: false, .. } => numbers!(u32),
        Datatype::FixedPoint { size: 8, signed: true, .. } => numbers!(i64),
        Datatype::FixedPoint { size: 8, signed: false, .. } => numbers!(u64),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use dynid_random::Random;

    use super::*;

    /// Written by h5py as MATLAB writes: `t` (6 x 1, doubles), `q` (6 x 2, compressed), `arm.i` (1 x 6, int16), `on` (6 x 1, logical),
    /// `name` (char), `gain` (1 x 1), `none` (empty).
    const FILE: &[u8] = include_bytes!("matlab73/log.mat");

    #[test]
    fn variables_are_columns() {
        let (columns, remarks) = columns(FILE.to_vec(), 1 << 20).unwrap();
        let of = |name: &str| columns.iter().find(|own| own.name == name).unwrap().values.clone();
        assert_eq!(of("t"), [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]);
        assert_eq!(of("q[0]"), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(of("q[1]"), [-1.5, -2.5, -3.5, -4.5, -5.5, -6.5]);
        assert_eq!(of("arm.i"), [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0]);
        assert_eq!(of("on"), [0.0, 1.0, 0.0, 1.0, 0.0, 1.0]);
        assert_eq!(columns.len(), 5);
        assert_eq!(remarks, [Remark::OtherLengths { n_rows: 6, names: vec!["gain".to_owned()] }]);
    }

    #[test]
    fn what_is_cut_or_damaged_is_an_error_or_a_table() {
        for length in (0..FILE.len()).step_by(7) {
            // No panic; what holds all its numbers in what is left is a table.
            drop(columns(FILE[..length].to_vec(), 1 << 20));
        }
        assert!(columns(FILE.to_vec(), 100).unwrap_err().to_string().contains("more bytes than may be unpacked"));
        assert!(
            columns(FILE[..600].to_vec(), 1 << 20).unwrap_err().to_string().contains("no whole file of MATLAB 7.3")
        );
        let mut random = Random::new(3);
        for _ in 0..1000 {
            let mut bytes = FILE.to_vec();
            for _ in 0..4 {
                let place = random.between(512.0, bytes.len() as f64) as usize;
                bytes[place] = random.between(0.0, 256.0) as u8;
            }
            drop(columns(bytes, 1 << 20));
        }
    }
}
