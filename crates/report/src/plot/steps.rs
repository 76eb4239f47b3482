//! A ladder as a picture: one error per model and joint on a logarithmic scale, with the noise floor below.

use std::fmt::Write;

use super::{LEFT, RIGHT, STYLE, TITLE, WIDTH, escaped, shortened};
use dynid_format::number;

/// Errors over the models of a lineage.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Steps {
    /// What it shows.
    pub title: String,
    /// What the vertical axis shows, with its unit.
    pub quantity: String,
    /// The models, first to last.
    pub rungs: Vec<String>,
    /// Name, and one value a rung.
    pub series: Vec<(String, Vec<Option<f64>>)>,
    /// A line below which nothing is left to explain.
    pub floor: Option<f64>,
}

const HEIGHT: f64 = 210.0;
const LABELS: f64 = 58.0;

/// Colours of Okabe & Ito (2008) that stand out on white and on black, each with a dash and a marker of its own.
pub(super) const DASHES: [&str; 6] = ["none", "7 3", "2 3", "9 3 2 3", "4 2", "12 4"];

/// Pictures below each other, as an `.svg` file.
pub fn standalone(pictures: &[Steps]) -> String {
    let height: f64 = pictures.iter().map(height).sum();
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"dynid-plot\" viewBox=\"0 0 {WIDTH} {height}\" \
         width=\"{WIDTH}\" height=\"{height}\" role=\"img\">\n<style>{STYLE}</style>\n"
    );
    let mut top = 0.0;
    for picture in pictures {
        let _ = writeln!(svg, "<g transform=\"translate(0 {top})\">");
        draw(&mut svg, picture);
        svg.push_str("</g>\n");
        top += self::height(picture);
    }
    svg.push_str("</svg>\n");
    svg
}

/// A picture for a page that has [`STYLE`] in its head.
pub fn inline(picture: &Steps) -> String {
    let mut svg = format!(
        "<svg class=\"dynid-plot\" viewBox=\"0 0 {WIDTH} {}\" role=\"img\" aria-label=\"{}\">\n",
        height(picture),
        escaped(&picture.title)
    );
    draw(&mut svg, picture);
    svg.push_str("</svg>\n");
    svg
}

fn height(_: &Steps) -> f64 {
    TITLE + HEIGHT + LABELS
}

fn draw(svg: &mut String, picture: &Steps) {
    let _ = writeln!(
        svg,
        "<rect class=\"paper\" width=\"{WIDTH}\" height=\"{}\"/>\n<text class=\"title\" x=\"{LEFT}\" y=\"20\">{}</text>",
        height(picture),
        escaped(&shortened(&picture.title))
    );
    let right = WIDTH - RIGHT - 130.0;
    let values = picture.series.iter().flat_map(|(_, values)| values.iter().flatten().copied()).chain(picture.floor);
    let (low, high) = values
        .filter(|value| *value > 0.0 && value.is_finite())
        .fold((f64::INFINITY, 0.0_f64), |(low, high), value| (low.min(value), high.max(value)));
    if low > high {
        return;
    }
    let (low, high) = ((low.log10() - 0.12).min(high.log10() - 0.3), high.log10() + 0.12);
    let y = |value: f64| TITLE + HEIGHT * (high - value.log10()) / (high - low);
    let x = |rung: usize| LEFT + (right - LEFT) * (rung as f64 + 0.5) / picture.rungs.len().max(1) as f64;
    for tick in ticks(low, high) {
        let at = y(tick);
        let _ = writeln!(
            svg,
            "<path class=\"grid\" d=\"M{LEFT} {at:.1}H{right}\"/><text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" \
             text-anchor=\"end\">{}</text>",
            LEFT - 6.0,
            at + 4.0,
            label(tick)
        );
    }
    let middle = TITLE + 0.5 * HEIGHT;
    let _ = writeln!(
        svg,
        "<rect class=\"frame\" x=\"{LEFT}\" y=\"{TITLE}\" width=\"{}\" height=\"{HEIGHT}\"/>\
         <text class=\"tick\" text-anchor=\"middle\" transform=\"translate(14 {middle:.1}) rotate(-90)\">{}</text>",
        right - LEFT,
        escaped(&picture.quantity)
    );
    // What stands at the right end, where it belongs: height, class and text.
    let mut names: Vec<(f64, String, &str)> = Vec::new();
    if let Some(floor) = picture.floor.filter(|floor| *floor > 0.0) {
        let at = y(floor);
        let _ = writeln!(svg, "<path class=\"floor\" d=\"M{LEFT} {at:.1}H{right}\"/>");
        names.push((at, "tick".to_owned(), "noise"));
    }
    for (index, (name, values)) in picture.series.iter().enumerate() {
        let colour = index % 6;
        let points: Vec<(usize, f64)> = values
            .iter()
            .enumerate()
            .filter_map(|(rung, value)| Some((rung, (*value)?)))
            .filter(|(_, value)| *value > 0.0)
            .collect();
        let mut path = String::new();
        for (rung, value) in &points {
            let _ = write!(path, "{}{:.1} {:.1}", if path.is_empty() { 'M' } else { 'L' }, x(*rung), y(*value));
        }
        let dash = DASHES[colour];
        let _ = writeln!(svg, "<path class=\"line hue{colour}\" stroke-dasharray=\"{dash}\" d=\"{path}\"/>");
        for (rung, value) in &points {
            let _ = writeln!(
                svg,
                "<path class=\"mark hue{colour}\" d=\"{}\"><title>{}: {} {}</title></path>",
                marker(index % 4, x(*rung), y(*value)),
                escaped(&picture.rungs[*rung]),
                escaped(name),
                number(*value)
            );
        }
        names.extend(points.last().map(|(_, value)| (y(*value), format!("hue{colour}"), name.as_str())));
    }
    names.sort_by(|a, b| a.0.total_cmp(&b.0));
    let wanted: Vec<f64> = names.iter().map(|(at, ..)| *at).collect();
    for (at, (_, class, name)) in apart(&wanted, TITLE + 4.0, TITLE + HEIGHT + 12.0).into_iter().zip(&names) {
        let _ = writeln!(
            svg,
            "<text class=\"{class}\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            right + 6.0,
            at + 4.0,
            escaped(name)
        );
    }
    for (rung, name) in picture.rungs.iter().enumerate() {
        let room = ((right - LEFT) / picture.rungs.len() as f64 / 6.2).max(6.0) as usize;
        // Neighbours take turns between two lines, so that long names have room.
        let (line, room) = if picture.rungs.len() > 3 { (rung % 2, 2 * room) } else { (0, room) };
        let _ = writeln!(
            svg,
            "<text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            x(rung),
            TITLE + HEIGHT + 18.0 + 16.0 * line as f64,
            escaped(&ending(name, room))
        );
    }
}

/// Heights, ascending, moved so that neighbours are a line apart and stay between `top` and `bottom` as long as there is room.
fn apart(wanted: &[f64], top: f64, bottom: f64) -> Vec<f64> {
    const LINE: f64 = 14.0;
    let mut heights = wanted.to_vec();
    let mut least = top;
    for height in &mut heights {
        *height = height.max(least);
        least = *height + LINE;
    }
    let mut most = bottom;
    for height in heights.iter_mut().rev() {
        *height = height.min(most);
        most = *height - LINE;
    }
    heights
}

/// The end of a name that is too long.
fn ending(name: &str, room: usize) -> String {
    let length = name.chars().count();
    if length <= room {
        name.to_owned()
    } else {
        std::iter::once('\u{2026}').chain(name.chars().skip(length - room + 1)).collect()
    }
}

/// Disc, square, triangle, diamond.
pub(super) fn marker(kind: usize, x: f64, y: f64) -> String {
    match kind {
        0 => format!("M{:.1} {y:.1}a4 4 0 1 0 8 0a4 4 0 1 0 -8 0z", x - 4.0),
        1 => format!("M{:.1} {:.1}h7v7h-7z", x - 3.5, y - 3.5),
        2 => format!("M{x:.1} {:.1}l5 8h-10z", y - 5.0),
        _ => format!("M{x:.1} {:.1}l5 5l-5 5l-5 -5z", y - 5.0),
    }
}

/// 1, 2 and 5 times powers of ten between two logarithms; only powers of ten over wide ranges.
pub(super) fn ticks(low: f64, high: f64) -> Vec<f64> {
    let factors: &[f64] = if high - low > 2.5 { &[1.0] } else { &[1.0, 2.0, 5.0] };
    (low.floor() as i32..=high.ceil() as i32)
        .flat_map(|power| factors.iter().map(move |factor| factor * 10_f64.powi(power)))
        .filter(|tick| (low..=high).contains(&tick.log10()))
        .collect()
}

/// A tick as short as it can be written.
pub(super) fn label(tick: f64) -> String {
    let power = (tick.log10() + 1e-9).floor() as i32;
    let text = if (-3..4).contains(&power) {
        format!("{tick:.*}", (-power).max(0) as usize)
    } else {
        format!("{:.0}e{power}", tick / 10_f64.powi(power))
    };
    text.replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ladder_has_a_mark_per_model_and_joint_and_its_floor() {
        let steps = Steps {
            title: "validate".to_owned(),
            quantity: "RMS [rad]".to_owned(),
            rungs: vec!["believed".to_owned(), "<better>".to_owned()],
            series: vec![
                ("joint 0".to_owned(), vec![Some(0.1), Some(2e-4)]),
                ("joint 1".to_owned(), vec![None, Some(3e-4)]),
            ],
            floor: Some(2e-4),
        };
        let svg = standalone(&[steps]);
        assert_eq!(svg.matches("class=\"mark").count(), 3);
        assert_eq!(svg.matches("class=\"floor\"").count(), 1);
        assert!(svg.contains("&lt;better&gt;") && !svg.contains("NaN"));
        assert!(standalone(&[Steps::default()]).contains("</svg>"), "nothing to draw is no failure");
    }

    #[test]
    fn names_stand_a_line_apart_and_inside() {
        assert_eq!(apart(&[10.0, 12.0, 100.0], 0.0, 100.0), [10.0, 24.0, 100.0]);
        assert_eq!(apart(&[98.0, 99.0, 100.0], 0.0, 100.0), [72.0, 86.0, 100.0]);
        assert_eq!(apart(&[], 0.0, 1.0), Vec::<f64>::new());
    }

    #[test]
    fn ticks_of_a_logarithmic_axis_are_round() {
        let labels: Vec<String> = ticks(-1.3, 0.4).into_iter().map(label).collect();
        assert_eq!(labels, ["0.1", "0.2", "0.5", "1", "2"]);
        assert_eq!(super::label(2e-4), "2e\u{2212}4");
    }
}
