//! A torque and the terms that it is made of, over time.

use std::fmt::Write;

use super::{
    Area, Axis, FOOT, GAP, LEFT, Margin, RIGHT, TITLE, WIDTH, curve, escaped, foot, frame, on_page, shortened,
    steps::DASHES, view,
};

/// A signal as the sum of others.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Terms {
    /// What it shows.
    pub title: String,
    /// What the vertical axis shows, with its unit.
    pub quantity: String,
    /// s
    pub time: Vec<f64>,
    /// What the whole is called, and it.
    pub whole: (String, Vec<f64>),
    /// What each part is called, and it.
    pub parts: Vec<(String, Vec<f64>)>,
}

const HEIGHT: f64 = 200.0;
/// Names in a row of the legend, and the height of a row.
const COLUMNS: usize = 4;
const ROW: f64 = 18.0;

/// A picture for a page that has [`super::STYLE`] in its head.
pub fn inline(terms: &Terms) -> String {
    let rows = (terms.parts.len() + 1).div_ceil(COLUMNS) as f64;
    let top = TITLE - 14.0 + rows * ROW;
    let height = top + HEIGHT + FOOT + GAP;
    on_page(&terms.title, &terms.time, height, |svg| {
        let _ = writeln!(
            svg,
            "<rect class=\"paper\" width=\"{WIDTH}\" height=\"{height}\"/>\n\
             <text class=\"title\" x=\"{LEFT}\" y=\"20\">{}</text>",
            escaped(&shortened(&terms.title))
        );
        let place = Area { top, height: HEIGHT };
        let time = Axis::around(&[&terms.time], 8, Margin::None);
        let mut all: Vec<&[f64]> = terms.parts.iter().map(|(_, values)| values.as_slice()).collect();
        all.push(&terms.whole.1);
        let values = Axis::around(&all, 6, Margin::Some);
        frame(svg, &place, &time, &values, &terms.quantity);
        view(svg, &place, &values, |svg| {
            curve(svg, "measured", "", &place, &time, &values, &terms.time, &terms.whole.1);
            for (index, (_, part)) in terms.parts.iter().enumerate() {
                let (class, dash) = style(index);
                let more = format!(" stroke-dasharray=\"{dash}\"");
                curve(svg, &class, &more, &place, &time, &values, &terms.time, part);
            }
        });
        let names = std::iter::once(&terms.whole.0).chain(terms.parts.iter().map(|(name, _)| name));
        for (index, name) in names.enumerate() {
            let width = (WIDTH - LEFT - RIGHT) / COLUMNS as f64;
            let x = LEFT + width * (index % COLUMNS) as f64;
            let y = TITLE - 8.0 + ROW * (index / COLUMNS) as f64;
            let (class, dash) = index.checked_sub(1).map_or_else(|| ("measured".to_owned(), "none"), style);
            let _ = writeln!(
                svg,
                "<path class=\"{class}\" stroke-dasharray=\"{dash}\" d=\"M{x:.1} {:.1}h24\"/>\
                 <text x=\"{:.1}\" y=\"{y:.1}\">{}</text>",
                y - 4.0,
                x + 29.0,
                escaped(name)
            );
        }
        foot(svg, &time, top + HEIGHT);
    })
}

/// Hue and dash of a part: the dashes shift when the hues come round again.
fn style(index: usize) -> (String, &'static str) {
    (format!("line hue{}", index % 6), DASHES[(index + index / 6) % 6])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_has_a_curve_and_a_name_and_no_two_look_alike() {
        let parts = (0..9).map(|k| (format!("part {k}"), vec![f64::from(k), 1.0])).collect();
        let terms =
            Terms { time: vec![0.0, 1.0], whole: ("all & more".to_owned(), vec![2.0, 3.0]), parts, ..Terms::default() };
        let svg = inline(&terms);
        assert_eq!(svg.matches(" curve\"").count(), 10);
        assert!(svg.contains("all &amp; more") && svg.contains("part 8"));
        let mut styles: Vec<(String, &str)> = (0..9).map(style).collect();
        styles.sort();
        styles.dedup();
        assert_eq!(styles.len(), 9);
    }
}
