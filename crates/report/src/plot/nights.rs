//! Estimates night by night, with their errors, what explains them, and where the others of the fleet are.

use std::fmt::Write;

use super::{Axis, LEFT, Margin, RIGHT, TITLE, WIDTH, escaped, shortened};
use dynid_format::number;

/// A quantity of a robot over nights.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Nights {
    /// What it shows.
    pub title: String,
    /// What the vertical axis shows, with its unit.
    pub quantity: String,
    /// Names of all nights.
    pub nights: Vec<String>,
    /// Place of the night, value, standard error.
    pub estimates: Vec<(usize, f64, f64)>,
    /// What explains them: place of the night and value, rising.
    pub explained: Vec<(usize, f64)>,
    /// First and last night in which it may have begun.
    pub since: Option<[usize; 2]>,
    /// Middle half of the other robots.
    pub others: Option<[f64; 2]>,
}

const HEIGHT: f64 = 170.0;
const FOOT: f64 = 34.0;
/// Names of nights below the picture have room for so many characters in all.
const ROOM: usize = 90;

/// A picture for a page that has [`super::STYLE`] in its head.
pub fn inline(picture: &Nights) -> String {
    let height = TITLE + HEIGHT + FOOT;
    let mut svg = format!(
        "<svg class=\"dynid-plot\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"{0}\">\n\
         <rect class=\"paper\" width=\"{WIDTH}\" height=\"{height}\"/>\n<text class=\"title\" x=\"{LEFT}\" y=\"20\">{1}</text>\n",
        escaped(&picture.title),
        escaped(&shortened(&picture.title))
    );
    draw(&mut svg, picture);
    svg.push_str("</svg>\n");
    svg
}

fn draw(svg: &mut String, picture: &Nights) {
    let (right, bottom) = (WIDTH - RIGHT, TITLE + HEIGHT);
    let ends = picture.estimates.iter().flat_map(|(_, value, error)| [value - error, value + error]);
    let shown: Vec<f64> =
        ends.chain(picture.explained.iter().map(|own| own.1)).chain(picture.others.into_iter().flatten()).collect();
    let axis = Axis::around(&[&shown], 4, Margin::Some);
    let y = |value: f64| axis.place(value, bottom, TITLE);
    let each = (right - LEFT) / picture.nights.len().max(1) as f64;
    let x = |night: usize| LEFT + each * (night as f64 + 0.5);
    if let Some([from, to]) = picture.since {
        let _ = writeln!(
            svg,
            "<rect class=\"band\" x=\"{:.1}\" y=\"{TITLE}\" width=\"{:.1}\" height=\"{HEIGHT}\"><title>since {} to {}</title></rect>",
            x(from) - 0.5 * each,
            each * (to - from + 1) as f64,
            escaped(&picture.nights[from]),
            escaped(&picture.nights[to])
        );
    }
    for tick in &axis.ticks {
        let _ = writeln!(
            svg,
            "<path class=\"grid\" d=\"M{LEFT} {0:.1}H{right}\"/><text class=\"tick\" x=\"{1}\" y=\"{2:.1}\" \
             text-anchor=\"end\">{3}</text>",
            y(*tick),
            LEFT - 6.0,
            y(*tick) + 4.0,
            axis.label(*tick)
        );
    }
    for value in picture.others.into_iter().flatten() {
        let _ = writeln!(
            svg,
            "<path class=\"floor\" d=\"M{LEFT} {:.1}H{right}\"><title>middle half of the other robots</title></path>",
            y(value)
        );
    }
    let _ = writeln!(
        svg,
        "<rect class=\"frame\" x=\"{LEFT}\" y=\"{TITLE}\" width=\"{:.1}\" height=\"{HEIGHT}\"/>\
         <text class=\"tick\" text-anchor=\"middle\" transform=\"translate(14 {:.1}) rotate(-90)\">{}</text>",
        right - LEFT,
        TITLE + 0.5 * HEIGHT,
        escaped(&picture.quantity)
    );
    let mut path = String::new();
    for (night, value) in &picture.explained {
        let _ = write!(path, "{}{:.1} {:.1}", if path.is_empty() { 'M' } else { 'L' }, x(*night), y(*value));
    }
    let _ = writeln!(svg, "<path class=\"line hue1\" d=\"{path}\"/>");
    for (night, value, error) in &picture.estimates {
        let _ = writeln!(
            svg,
            "<path class=\"residual\" d=\"M{0:.1} {1:.1}V{2:.1}\"/><circle class=\"mark hue0\" cx=\"{0:.1}\" cy=\"{3:.1}\" r=\"3\">\
             <title>{4}: {5} \u{b1} {6}</title></circle>",
            x(*night),
            y(value - error),
            y(value + error),
            y(*value),
            escaped(&picture.nights[*night]),
            number(*value),
            number(*error)
        );
    }
    let longest = picture.nights.iter().map(|name| name.chars().count()).max().unwrap_or(1);
    let every = (picture.nights.len() * (longest + 2)).div_ceil(ROOM).max(1);
    for (night, name) in picture.nights.iter().enumerate().step_by(every) {
        let _ = writeln!(
            svg,
            "<text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            x(night),
            bottom + 18.0,
            escaped(name)
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_night_has_its_mark_and_names_are_text() {
        let picture = Nights {
            title: "<r1>".to_owned(),
            nights: (0..40).map(|k| format!("<{k}>")).collect(),
            estimates: (0..40).map(|k| (k, 1.0 + f64::from(u8::from(k > 20)), 0.1)).collect(),
            explained: vec![(0, 1.0), (20, 1.0), (21, 2.0), (39, 2.0)],
            since: Some([20, 22]),
            ..Nights::default()
        };
        let svg = inline(&picture);
        assert_eq!(svg.matches("<circle").count(), 40);
        assert!(!svg.contains("<r1>") && !svg.contains("<3>") && svg.contains("&lt;r1&gt;"));
        assert!(!svg.contains("NaN"));
    }
}
