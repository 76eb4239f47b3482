//! Readers of files that the program alone has, for those who put them to the test (`tests/fuzz`).

use std::path::Path;

/// Reads the text of a job file of any name.
pub fn job(text: &str) -> Result<(), String> {
    let content = super::job::file::Content::parse(text, Path::new("job.json"));
    content.and_then(super::job::file::Job::new).map(drop).map_err(|error| super::told(&error))
}

/// Whether this is the text of a checkpoint of a diagnosis.
pub fn diagnosis_checkpoint(text: &str) -> bool {
    super::diagnose::is_checkpoint(text)
}
