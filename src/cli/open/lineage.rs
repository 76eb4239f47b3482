//! Which model of the folder comes from which, by what their files record.

use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use dynid::Model;
use dynid_judge::ladder::Lineage;
use serde_json::{Value, json};

use super::App;
use super::answer::{Answered, Refusal, blocking};

/// `GET api/lineage`
pub async fn lineage(State(app): State<Arc<App>>) -> Answered {
    blocking(move || {
        let (mut files, _) = app.folder.files();
        files.retain(|file| file["kind"] == "model");
        files.sort_by_key(|file| file["modified"].as_u64());
        let read = |file: &Value| {
            let path = file["path"].as_str().unwrap_or_default();
            let model = app.folder.place(path).and_then(|place| {
                app.folder.check_references(&place)?;
                app.effects.known(Model::load(&place))
            });
            (path.to_owned(), model.map(|model| (model.digest(), model)))
        };
        let models: Vec<Read> = files.iter().map(read).collect();
        let told: Vec<Value> = (0..models.len()).map(|place| told(&models, place)).collect();
        Ok(Json(json!({ "models": told })))
    })
    .await
}

/// A model's path, and the model with its digest.
type Read = (String, Result<(String, Model), Refusal>);

fn told(models: &[Read], place: usize) -> Value {
    let (path, own) = &models[place];
    let (digest, own) = match own {
        Ok(own) => own,
        Err(refusal) => return json!({ "path": path, "parent": null, "how": null, "error": refusal.sentence }),
    };
    let known = models.iter().filter_map(|(path, model)| Some((path, model.as_ref().ok()?)));
    let older = || models[..place].iter().rev().filter_map(|(path, model)| Some((path, model.as_ref().ok()?)));
    let recorded = own.fit.as_ref().map(|fit| &fit.parent_digest);
    // What was copied may be younger than what came of it.
    let by_record = older().chain(known.filter(|(_, (other, _))| other != digest));
    let by_record = by_record
        .filter(|(_, (other, _))| Some(other) == recorded)
        .map(|(path, (_, other))| (path, Lineage::of(other, own)));
    let by_content =
        older().map(|(path, (_, other))| (path, Lineage::of(other, own))).filter(|(_, how)| how.is_child());
    let (parent, how) = by_record.chain(by_content).next().unzip();
    json!({ "path": path, "parent": parent, "how": how })
}
