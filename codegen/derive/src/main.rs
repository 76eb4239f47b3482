//! `dynid-derive`: device -> `generated/<device>/cNN.kir`.

fn main() -> anyhow::Result<()> {
    for device in dynid_model::devices() {
        for (path, text) in dynid_derive::generate(device, &dynid_derive::Options::default())? {
            println!("{}\n{}", path.display(), text.lines().take(12).collect::<Vec<_>>().join("\n"));
        }
    }
    Ok(())
}
