//! Several curves on axes that are given, so that pictures beside each other can be compared.

use std::fmt::Write;

use super::{
    Area, Axis, FOOT, GAP, LEFT, Margin, RIGHT, TITLE, WIDTH, curve, escaped, foot_of, frame, on_page, steps::DASHES,
    view,
};

/// One curve.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trace {
    /// What the legend calls it.
    pub name: String,
    /// Where.
    pub along: Vec<f64>,
    /// What, one each.
    pub values: Vec<f64>,
}

/// Curves over one axis.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Traces {
    /// What it shows.
    pub title: String,
    /// What the horizontal axis shows, with its unit.
    pub along: String,
    /// What the vertical axis shows, with its unit.
    pub quantity: String,
    /// The part of the horizontal axis that is shown.
    pub across: [f64; 2],
    /// The part of the vertical axis that is shown, at least.
    pub up: [f64; 2],
    /// Curves; the first of several is wide and pale, what the others are compared with.
    pub curves: Vec<Trace>,
    /// Broken lines at these heights.
    pub levels: Vec<f64>,
}

const HEIGHT: f64 = 190.0;
/// Names in a row of the legend, and the height of a row.
const COLUMNS: usize = 5;
const ROW: f64 = 18.0;

/// A picture for a page that has [`super::STYLE`] in its head.
pub fn inline(traces: &Traces) -> String {
    let rows = if traces.curves.len() > 1 { traces.curves.len().div_ceil(COLUMNS) as f64 } else { 0.0 };
    let top = TITLE - 14.0 + rows * ROW;
    let height = top + HEIGHT + FOOT + GAP;
    on_page(&traces.title, &traces.across, height, |svg| {
        let _ = writeln!(
            svg,
            "<rect class=\"paper\" width=\"{WIDTH}\" height=\"{height}\"/>\n\
             <text class=\"title\" x=\"{LEFT}\" y=\"20\">{}</text>",
            escaped(&traces.title)
        );
        let place = Area { top, height: HEIGHT };
        let across = Axis::around(&[&traces.across], 8, Margin::None);
        let up = Axis::around(&[&traces.up], 6, Margin::Some);
        frame(svg, &place, &across, &up, &traces.quantity);
        view(svg, &place, &up, |svg| {
            for level in &traces.levels {
                curve(svg, "floor", "", &place, &across, &up, &traces.across, &[*level, *level]);
            }
            for (index, own) in traces.curves.iter().enumerate() {
                let (class, dash) = style(index, traces.curves.len());
                let more = format!(" stroke-dasharray=\"{dash}\"");
                curve(svg, &class, &more, &place, &across, &up, &own.along, &own.values);
            }
        });
        if rows > 0.0 {
            for (index, own) in traces.curves.iter().enumerate() {
                let width = (WIDTH - LEFT - RIGHT) / COLUMNS as f64;
                let x = LEFT + width * (index % COLUMNS) as f64;
                let y = TITLE - 4.0 + ROW * (index / COLUMNS) as f64;
                let (class, dash) = style(index, traces.curves.len());
                let _ = writeln!(
                    svg,
                    "<path class=\"{class}\" stroke-dasharray=\"{dash}\" d=\"M{x:.1} {:.1}h24\"/>\
                     <text x=\"{:.1}\" y=\"{y:.1}\">{}</text>",
                    y - 4.0,
                    x + 29.0,
                    escaped(&own.name)
                );
            }
        }
        foot_of(svg, &across, top + HEIGHT, &traces.along);
    })
}

/// Class and dash of a curve; one alone has nothing to be paler than.
fn style(index: usize, count: usize) -> (String, &'static str) {
    if index == 0 && count > 1 {
        return ("measured".to_owned(), "none");
    }
    let other = index.saturating_sub(1);
    (format!("line hue{}", (other + 1) % 6), DASHES[(other + other / 6) % 6])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_curve_has_a_name_and_the_axes_are_those_given() {
        let curves = (0..3)
            .map(|k| Trace { name: format!("w&{k}"), along: vec![0.0, 9.0], values: vec![f64::from(k), 40.0] })
            .collect();
        let traces = Traces {
            across: [0.0, 2.0],
            up: [-1.0, 1.0],
            curves,
            levels: vec![0.5],
            along: "t".to_owned(),
            ..Traces::default()
        };
        let svg = inline(&traces);
        assert!(svg.contains("data-from=\"0\" data-to=\"2\"") && svg.contains("data-low=\"-1.12\" data-high=\"1.12\""));
        assert_eq!(svg.matches(" curve\"").count(), 4);
        assert!(svg.contains(">w&amp;2</text>") && svg.contains(">t</text>"));
        assert!(inline(&Traces::default()).ends_with("</svg>\n"), "nothing to draw is no failure");
    }
}
