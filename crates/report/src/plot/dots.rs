//! A dot for every case, in groups side by side, on a logarithmic scale.

use std::fmt::Write;

use super::{
    LEFT, RIGHT, TITLE, WIDTH, escaped,
    steps::{label, marker, ticks},
};
use dynid_format::number;

/// Groups of dots.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Dots {
    /// What it shows.
    pub title: String,
    /// What the vertical axis shows, with its unit.
    pub quantity: String,
    /// Groups, left to right.
    pub groups: Vec<String>,
    /// Kinds within each group, left to right.
    pub kinds: Vec<String>,
    /// Values by group, then by kind.
    pub values: Vec<Vec<Vec<f64>>>,
}

const HEIGHT: f64 = 230.0;
const FOOT: f64 = 30.0;
/// Powers of ten below the largest value that are shown at most; what is smaller stands at the lower border.
const DEEPEST: f64 = 5.0;

/// A picture for a page that has [`super::STYLE`] in its head.
pub fn inline(dots: &Dots) -> String {
    let height = TITLE + HEIGHT + FOOT;
    let mut svg = format!(
        "<svg class=\"dynid-plot\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"{0}\">\n\
         <rect class=\"paper\" width=\"{WIDTH}\" height=\"{height}\"/>\n<text class=\"title\" x=\"{LEFT}\" y=\"20\">{0}</text>\n",
        escaped(&dots.title)
    );
    let shown = dots.values.iter().flatten().flatten().copied().filter(|value| *value > 0.0 && value.is_finite());
    let (low, high) = shown.fold((f64::INFINITY, 0.0_f64), |(low, high), value| (low.min(value), high.max(value)));
    if low <= high {
        let high = high.log10() + 0.12;
        draw(&mut svg, dots, (low.log10() - 0.12).clamp(high - DEEPEST, high - 0.4), high);
    }
    svg.push_str("</svg>\n");
    svg
}

fn draw(svg: &mut String, dots: &Dots, low: f64, high: f64) {
    let (right, bottom) = (WIDTH - RIGHT, TITLE + HEIGHT);
    let y = |value: f64| {
        let logarithm = value.max(f64::MIN_POSITIVE).log10().clamp(low, high);
        TITLE + HEIGHT * (high - logarithm) / (high - low)
    };
    for tick in ticks(low, high) {
        let _ = writeln!(
            svg,
            "<path class=\"grid\" d=\"M{LEFT} {0:.1}H{right}\"/><text class=\"tick\" x=\"{1}\" y=\"{2:.1}\" \
             text-anchor=\"end\">{3}</text>",
            y(tick),
            LEFT - 6.0,
            y(tick) + 4.0,
            label(tick)
        );
    }
    let _ = writeln!(
        svg,
        "<rect class=\"frame\" x=\"{LEFT}\" y=\"{TITLE}\" width=\"{}\" height=\"{HEIGHT}\"/>\
         <text class=\"tick\" text-anchor=\"middle\" transform=\"translate(14 {}) rotate(-90)\">{}</text>",
        right - LEFT,
        TITLE + 0.5 * HEIGHT,
        escaped(&dots.quantity)
    );
    for (kind, name) in dots.kinds.iter().enumerate() {
        let x = right - 96.0 * (dots.kinds.len() - kind) as f64;
        let _ = writeln!(
            svg,
            "<path class=\"mark hue{0}\" d=\"{1}\"/><text x=\"{2}\" y=\"36\">{3}</text>",
            kind % 6,
            marker(kind % 4, x + 6.0, 32.0),
            x + 16.0,
            escaped(name)
        );
    }
    let group_width = (right - LEFT) / dots.groups.len().max(1) as f64;
    let kind_width = 0.86 * group_width / dots.kinds.len().max(1) as f64;
    for (group, (name, kinds)) in dots.groups.iter().zip(&dots.values).enumerate() {
        let start = LEFT + group_width * group as f64;
        if group > 0 {
            let _ = writeln!(svg, "<path class=\"grid\" d=\"M{start:.1} {TITLE}V{bottom}\"/>");
        }
        let _ = writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            start + 0.5 * group_width,
            bottom + 18.0,
            escaped(name)
        );
        for (kind, values) in kinds.iter().enumerate() {
            let left = start + 0.07 * group_width + kind_width * kind as f64;
            // Kinds stand a little apart.
            let each = 0.84 * kind_width / values.len().max(1) as f64;
            for (index, value) in values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
                let _ = writeln!(
                    svg,
                    "<path class=\"mark hue{}\" d=\"{}\"><title>{}, {}, {index}: {}</title></path>",
                    kind % 6,
                    marker(kind % 4, left + each * (index as f64 + 0.5), y(*value)),
                    escaped(name),
                    escaped(dots.kinds.get(kind).map_or("", String::as_str)),
                    number(*value)
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_case_has_a_dot_also_where_there_is_nothing() {
        let dots = Dots {
            groups: vec!["a".to_owned(), "<b>".to_owned()],
            kinds: vec!["slow".to_owned(), "fast".to_owned()],
            values: vec![vec![vec![1e-3, 0.0], vec![2e-2]], vec![vec![5e-5], vec![f64::NAN, 1e-30]]],
            ..Dots::default()
        };
        let svg = inline(&dots);
        assert_eq!(svg.matches("<title>").count(), 5, "what is no number is left out");
        assert!(svg.contains("&lt;b&gt;") && !svg.contains("NaN") && !svg.contains("inf"));
        assert!(inline(&Dots::default()).ends_with("</svg>\n"), "nothing to draw is no failure");
    }
}
