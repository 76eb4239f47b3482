//! Triangular membership functions over an input.

use std::fmt::Write;

use super::{Axis, LEFT, Margin, RIGHT, WIDTH, escaped};
use dynid_control::Partition;

/// The fuzzy sets of an input, or those of a part of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Memberships<'a> {
    /// What it shows.
    pub title: String,
    /// What the input is, with its unit.
    pub along: String,
    /// Its sets.
    pub sets: &'a Partition,
    /// The part that is shown.
    pub range: [f64; 2],
    /// A part that is shaded.
    pub shaded: Option<[f64; 2]>,
}

const TOP: f64 = 58.0;
const HEIGHT: f64 = 110.0;
const FOOT: f64 = 40.0;
/// Names stand so far apart at least (pixels).
const APART: f64 = 26.0;

/// A picture for a page that has [`super::STYLE`] in its head.
pub fn inline(picture: &Memberships<'_>) -> String {
    let (height, right, bottom) = (TOP + HEIGHT + FOOT, WIDTH - RIGHT, TOP + HEIGHT);
    let mut svg = format!(
        "<svg class=\"dynid-plot\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"{0}\">\n\
         <rect class=\"paper\" width=\"{WIDTH}\" height=\"{height}\"/>\n<text class=\"title\" x=\"{LEFT}\" y=\"20\">{0}</text>\n",
        escaped(&picture.title)
    );
    let along = Axis::around(&[&picture.range], 8, Margin::None);
    let x = |value: f64| along.place(value.clamp(along.from, along.to), LEFT, right);
    let y = |share: f64| bottom - share * HEIGHT;
    if let Some([from, to]) = picture.shaded {
        let _ = writeln!(
            svg,
            "<rect class=\"band\" x=\"{:.1}\" y=\"{TOP}\" width=\"{:.1}\" height=\"{HEIGHT}\"/>",
            x(from),
            x(to) - x(from)
        );
    }
    for share in [0.0, 0.5, 1.0] {
        let _ = writeln!(
            svg,
            "<path class=\"grid\" d=\"M{LEFT} {0:.1}H{right}\"/><text class=\"tick\" x=\"{1}\" y=\"{2:.1}\" \
             text-anchor=\"end\">{share:.1}</text>",
            y(share),
            LEFT - 6.0,
            y(share) + 4.0
        );
    }
    let peaks = picture.sets.peaks();
    let mut last_name = f64::NEG_INFINITY;
    for (index, name) in picture.sets.names().iter().enumerate() {
        let ends = [index.saturating_sub(1), (index + 1).min(peaks.len() - 1)];
        if peaks[ends[1]] < along.from || peaks[ends[0]] > along.to {
            continue;
        }
        // Straight between the peaks: these points are the whole function.
        let mut places = vec![along.from, along.to];
        places.extend(peaks[ends[0]..=ends[1]].first().into_iter().chain([&peaks[index], &peaks[ends[1]]]));
        places.retain(|place| (along.from..=along.to).contains(place));
        places.sort_by(f64::total_cmp);
        places.dedup();
        let mut path = String::new();
        for place in &places {
            let share = picture.sets.membership(index, *place);
            let _ = write!(path, "{}{:.1} {:.1}", if path.is_empty() { 'M' } else { 'L' }, x(*place), y(share));
        }
        let hue = index % 4;
        let _ = writeln!(svg, "<path class=\"line hue{hue}\" d=\"{path}\"><title>{}</title></path>", escaped(name));
        let at = x(peaks[index]);
        if (along.from..=along.to).contains(&peaks[index]) && at - last_name >= APART {
            last_name = at;
            let _ = writeln!(
                svg,
                "<text class=\"hue{hue}\" x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                TOP - 8.0,
                escaped(name)
            );
        }
    }
    let _ = writeln!(
        svg,
        "<rect class=\"frame\" x=\"{LEFT}\" y=\"{TOP}\" width=\"{}\" height=\"{HEIGHT}\"/>\
         <text class=\"tick\" text-anchor=\"middle\" transform=\"translate(14 {}) rotate(-90)\">membership</text>",
        right - LEFT,
        TOP + 0.5 * HEIGHT
    );
    for tick in &along.ticks {
        let _ = writeln!(
            svg,
            "<path class=\"frame\" d=\"M{:.1} {bottom}v4\"/><text class=\"tick\" x=\"{:.1}\" y=\"{}\" \
             text-anchor=\"middle\">{}</text>",
            x(*tick),
            x(*tick).min(WIDTH - 18.0),
            bottom + 16.0,
            along.label(*tick)
        );
    }
    let _ = writeln!(
        svg,
        "<text class=\"tick\" x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>\n</svg>",
        0.5 * (LEFT + right),
        bottom + 32.0,
        escaped(&picture.along)
    );
    svg
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sets() -> Partition {
        let names = ["N", "<Z>", "P", "Q"].map(str::to_owned).to_vec();
        Partition::new(names, vec![-1.0, 0.0, 0.01, 1.0]).expect("ascending")
    }

    fn shown(range: [f64; 2]) -> String {
        let sets = sets();
        inline(&Memberships {
            title: "x".to_owned(),
            along: "x [rad]".to_owned(),
            sets: &sets,
            range,
            shaded: Some([0.0, 0.01]),
        })
    }

    #[test]
    fn every_set_has_a_line_and_a_name_where_there_is_room() {
        let svg = shown([-1.0, 1.0]);
        assert_eq!(svg.matches("class=\"line ").count(), 4);
        assert_eq!(
            svg.matches("text-anchor=\"middle\">P</text>").count(),
            0,
            "it would stand on that of its neighbour"
        );
        assert!(svg.contains(">&lt;Z&gt;</text>") && !svg.contains("<Z>"));
        let near = shown([-0.005, 0.015]);
        assert!(near.contains("text-anchor=\"middle\">P</text>"));
        assert_eq!(near.matches("class=\"line ").count(), 4, "those whose peak is outside reach in");
    }

    #[test]
    fn a_part_shows_memberships_as_they_are_at_its_border() {
        let svg = shown([-0.5, 0.0]);
        // N has 0.5 at -0.5 and falls to 0 at 0
        let expected = format!("d=\"M{LEFT:.1} {:.1}L{:.1} {:.1}\"", TOP + 0.5 * HEIGHT, WIDTH - RIGHT, TOP + HEIGHT);
        assert!(svg.contains(&expected), "{svg}");
    }
}
