//! The tour: its data are what the plant makes.

use std::fs;
use std::path::Path;

use dynid_plant::recipe::{self, Recipe};

#[test]
fn the_plant_makes_the_same_logs_again() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/tour");
    let text = fs::read_to_string(folder.join("recipe.toml")).unwrap();
    let recipe: Recipe = toml::from_str(&text).unwrap();
    let device = dynid_model::device(&recipe.device).unwrap();
    let files = recipe::make(&recipe, device).unwrap();
    assert_eq!(files.len(), recipe.runs.len() + 1);
    for (name, made) in files {
        let kept = fs::read_to_string(folder.join(&name)).unwrap().replace("\r\n", "\n");
        assert!(made == kept, "{name} is not what the recipe makes; run `dynid-plant src/tour/recipe.toml <folder>`");
    }
}
