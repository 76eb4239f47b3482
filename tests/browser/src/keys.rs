//! Keys by name, as WebDriver codes them.

/// A key that is no character.
pub use fantoccini::key::Key;

/// The codes of a key, with what is held meanwhile: `Tab`, `Shift+Tab`, `Control+z`, `a`.
pub(crate) fn codes(keys: &str) -> Vec<char> {
    // A plus sign alone is the key itself.
    if keys == "+" {
        return vec!['+'];
    }
    keys.split('+').map(code).collect()
}

fn code(name: &str) -> char {
    let key = match name {
        "Tab" => Key::Tab,
        "Enter" => Key::Enter,
        "Escape" => Key::Escape,
        "Space" => return ' ',
        "Shift" => Key::Shift,
        "Control" => Key::Control,
        "Home" => Key::Home,
        "End" => Key::End,
        "ArrowLeft" => Key::Left,
        "ArrowRight" => Key::Right,
        "ArrowUp" => Key::Up,
        "ArrowDown" => Key::Down,
        _ => {
            let mut characters = name.chars();
            return match (characters.next(), characters.next()) {
                (Some(only), None) => only,
                _ => panic!("no key is called `{name}`"),
            };
        }
    };
    char::from(key)
}
