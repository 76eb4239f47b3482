//! `dynid-plant RECIPE.toml FOLDER`: makes logs of a device whose truth is known.

use std::path::Path;
use std::process::ExitCode;

use dynid_plant::recipe::{self, Recipe};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [recipe, folder] = arguments.as_slice() else {
        eprintln!("usage: dynid-plant RECIPE.toml FOLDER");
        return ExitCode::from(2);
    };
    match write(Path::new(recipe), Path::new(folder)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::from(2)
        }
    }
}

fn write(path: &Path, folder: &Path) -> Result<(), String> {
    let told = |path: &Path, error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    let text = std::fs::read_to_string(path).map_err(|error| told(path, &error))?;
    let recipe: Recipe = toml::from_str(&text).map_err(|error| told(path, &error))?;
    let device = dynid_model::device(&recipe.device)
        .ok_or_else(|| told(path, &format!("there is no device `{}`", recipe.device)))?;
    let files = recipe::make(&recipe, device).map_err(|error| told(path, &error))?;
    std::fs::create_dir_all(folder).map_err(|error| told(folder, &error))?;
    for (name, text) in files {
        let file = folder.join(&name);
        if file.exists() {
            return Err(told(&file, &"exists; choose another folder or remove it first"));
        }
        std::fs::write(&file, text).map_err(|error| told(&file, &error))?;
        println!("{}", file.display());
    }
    Ok(())
}
