//! Runs whose logs are at hand as tables, for programs that have no experiment file.

use std::path::Path;

use dynid_dynamics::simulate::Intersample;
use dynid_model::Device;
use dynid_tables::Table;
use toml::Value;
use toml::de::DeTable;

use crate::experiment::{ExperimentError, File, RUN_KEYS, Run, RunSource, Settings};
use crate::log::LogError;
use crate::noise::moves;

impl Run {
    /// The run of `device` that `settings` say, which are the keys of a `[[run]]` as an experiment file has them (TOML); its `file` only names
    /// `log`, and paths begin at `folder`. Where `free` is not said, the joints that move by more than noise are free.
    ///
    /// # Errors
    /// The first thing that is wrong with the settings or the log.
    pub fn given(device: &'static Device, settings: &str, folder: &Path, log: &Table) -> Result<Self, ExperimentError> {
        // Paths in an experiment begin at its file's folder.
        let path = folder.join("experiment");
        let file = File { path: &path, text: settings };
        let document = DeTable::parse(settings)
            .map_err(|error| file.invalid(0, error.message().to_owned(), "write it as TOML: `key = value`"))?;
        let (table, top) = (document.get_ref(), DeTable::new());
        let source = RunSource { file: &file, device, top: &top, table, start: 0, number: 1 };
        let run = file.known_keys(table, &RUN_KEYS).and_then(|()| source.read(Some(log)));
        run.map_err(|error| match error {
            // A place in a text that the user did not write says nothing.
            ExperimentError::Invalid { message, remedy, .. } => {
                let named = table.get("file").and_then(|name| name.get_ref().as_str());
                ExperimentError::Given { run: named.unwrap_or("run").to_owned(), message, remedy }
            }
            ExperimentError::Log { error, .. } => ExperimentError::GivenLog(error),
            other => other,
        })
    }

    /// The settings and the columns that [`Run::given`] makes this run of again, whatever the log was read from.
    pub fn as_given(&self) -> (String, Vec<(String, Vec<f64>)>) {
        let mut columns = vec![("t".to_owned(), self.log.t.clone())];
        let kinds = [("tau", Some(&self.log.tau)), ("q", Some(&self.log.q)), ("ref", self.log.reference.as_ref())];
        for (kind, joints) in kinds {
            let joints = (0..).zip(joints.into_iter().flatten());
            columns.extend(joints.map(|(joint, values)| (format!("{kind}{joint}"), values.clone())));
        }
        if let Some(mask) = &self.log.mask {
            columns.push(("mask".to_owned(), mask.iter().map(|&used| f64::from(u8::from(used))).collect()));
        }
        (self.settings_as_given(), columns)
    }

    fn settings_as_given(&self) -> String {
        let Settings {
            cutoff_hz,
            decimate,
            min_speed,
            intersample,
            controller,
            from_s,
            first_half,
            moving,
            start,
            // A part of a log is no run of an experiment.
            began_s: _,
        } = &self.settings;
        let numbers = |values: &[f64]| Value::Array(values.iter().copied().map(Value::from).collect());
        let whole = |number: usize| Value::from(number as i64);
        let hold = match intersample {
            Intersample::ZeroOrder => "zero",
            Intersample::FirstOrder => "linear",
        };
        let said = [
            ("file", Some(Value::from(self.file.as_str()))),
            ("role", Some(Value::from(self.role.to_string()))),
            ("free", Some(Value::Array(self.free.iter().copied().map(whole).collect()))),
            ("payload", self.payload.as_deref().map(Value::from)),
            ("cutoff_hz", cutoff_hz.map(Value::from)),
            ("decimate", Some(whole(*decimate))),
            ("min_speed", Some(numbers(min_speed))),
            ("hold", Some(Value::from(hold))),
            ("controller", controller.as_ref().map(|path| Value::from(path.to_string_lossy().into_owned()))),
            ("from_s", from_s.map(Value::from)),
            ("first_half", Some(Value::from(*first_half))),
            ("moving", Some(Value::from(*moving))),
            ("start", start.as_deref().map(numbers)),
            ("mask", self.log.mask.as_ref().map(|_| Value::from("mask"))),
        ];
        let said = said.into_iter().filter_map(|(key, value)| Some((key.to_owned(), value?)));
        said.collect::<toml::Table>().to_string()
    }
}

impl RunSource<'_> {
    /// The joints whose positions move by more than noise.
    pub(crate) fn moving(&self, table: &Table, columns: &[(String, String)]) -> Result<Vec<usize>, ExperimentError> {
        let mut free = Vec::new();
        for joint in 0..self.device.joints.len() {
            let logical = format!("q{joint}");
            let name = columns.iter().find(|(own, _)| *own == logical).map_or(&logical, |(_, name)| name);
            let Some(place) = table.names().iter().position(|own| own == name) else { continue };
            let wrong = |error| ExperimentError::GivenLog(Box::new(LogError::of_table(self.file.path, error)));
            let read = table.columns(&[place], 0..table.n_rows()).map_err(wrong)?;
            free.extend(moves(&read[0].values).then_some(joint));
        }
        if free.is_empty() {
            let message = "free: no column of a position moves by more than its noise".to_owned();
            let remedy = "say which joints were free, e.g. free = [0, 1], and which columns are their positions, \
                          e.g. columns = { q0 = \"position_0\" }";
            return Err(self.file.invalid(0, message, remedy));
        }
        Ok(free)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::{Experiment, Role};

    fn tour() -> Experiment {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../src/tour");
        Experiment::load(format!("{folder}/experiment.toml")).expect("the tour's logs")
    }

    fn again(run: &Run, device: &'static Device) -> Run {
        let (settings, columns) = run.as_given();
        Run::given(device, &settings, Path::new(""), &Table::of_numbers(columns)).expect("it is the same run")
    }

    #[test]
    fn a_run_is_made_again_of_what_it_gives() {
        let experiment = tour();
        let runs: Vec<Run> = experiment.runs.iter().map(|run| again(run, experiment.device)).collect();
        assert_eq!(Experiment::of_runs(&experiment.path, experiment.device, runs).digest, experiment.digest);

        let mut other = experiment.runs[0].clone();
        let n_joints = experiment.device.joints.len();
        other.role = Role::Validate;
        other.payload = Some("box".to_owned());
        other.log.reference = Some(other.log.q.clone());
        other.log.mask = Some((0..other.log.len()).map(|k| k % 3 != 0).collect());
        other.settings = Settings {
            cutoff_hz: Some(7.25),
            decimate: 3,
            min_speed: (0..n_joints).map(|joint| 0.1 * joint as f64).collect(),
            intersample: Intersample::FirstOrder,
            from_s: Some(0.5),
            first_half: 0.3,
            moving: true,
            start: Some(other.log.q.iter().map(|q| q[0]).collect()),
            ..other.settings
        };
        let made = again(&other, experiment.device);
        assert_eq!((made.role, &made.payload, &made.free), (other.role, &other.payload, &other.free));
        assert_eq!(made.settings, other.settings);
        // Of a run that is only planned the positions are not read.
        assert_eq!((&made.log.tau, &made.log.mask), (&other.log.tau, &other.log.mask));
    }

    #[test]
    fn joints_that_move_are_free_where_it_is_not_said() {
        let experiment = tour();
        let (_, columns) = experiment.runs[0].as_given();
        let table = Table::of_numbers(columns);
        let given = |settings: &str| Run::given(experiment.device, settings, Path::new(""), &table);
        assert_eq!(given("file = 'frame'\nrole = 'fit'").expect("two joints move").free, experiment.runs[0].free);
        let said = |settings: &str| given(settings).expect_err("something is wrong").to_string();
        assert_eq!(
            said("file = 'frame'\nrole = 'fitted'"),
            "frame: role: expected \"fit\" or \"validate\", found \"fitted\"; say \"fit\" for a run that parameters are \
             fitted to, \"validate\" for a held-out run"
        );
        let unknown = said("file = 'frame'\nrole = 'fit'\nfree = [4, 5]\ncolumns = { q4 = 'position' }");
        assert!(unknown.starts_with("frame: column `position` is missing; the log has `t`, `tau0`"), "{unknown}");
    }
}
