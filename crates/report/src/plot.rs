//! Pictures of logs: measured over simulated, and what is left, as SVG text.
//!
//! Wide and pale is measured, thin and strong is simulated, so that the two part in print and for every kind of
//! colour vision (blue and vermilion of Okabe & Ito 2008). The picture follows the viewer's light or dark scheme.
//! It carries no font, no script and no reference to anything outside itself.

pub mod dots;
pub mod memberships;
pub mod nights;
pub mod steps;
pub mod surface;
pub mod terms;
pub mod traces;

use std::fmt::Write;

use dynid_format::escaped;

/// One signal of one joint in one run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Panel {
    /// What it shows, e.g. `wrist-3.csv, joint 4`.
    pub title: String,
    /// What the vertical axis shows, e.g. `position`.
    pub quantity: String,
    /// Unit of the vertical axis, e.g. `rad`.
    pub unit: String,
    /// s
    pub time: Vec<f64>,
    /// From the log.
    pub measured: Vec<f64>,
    /// From the model.
    pub predicted: Vec<f64>,
    /// Standard deviation of the noise, where it is known: the residual plot shows twice that as a band.
    pub noise_floor: Option<f64>,
}

/// One curve over time, without anything to compare it with.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Curve {
    /// What it shows, e.g. `joint 4: torque`.
    pub title: String,
    /// What the vertical axis shows, with its unit, e.g. `torque [N*m]`.
    pub quantity: String,
    /// s
    pub time: Vec<f64>,
    /// One a time.
    pub values: Vec<f64>,
}

const WIDTH: f64 = 760.0;
const LEFT: f64 = 78.0;
const RIGHT: f64 = 14.0;
const TITLE: f64 = 44.0;
const OVERLAY: f64 = 170.0;
const GAP: f64 = 18.0;
const RESIDUAL: f64 = 90.0;
const FOOT: f64 = 40.0;

/// What a vertical axis has above and below its values, as a share of their range.
const MARGIN: f64 = 0.06;

/// Rules for every picture on a page; [`standalone`] brings them along.
pub const STYLE: &str = "\
.dynid-plot{font:12px system-ui,sans-serif;--ink:#1b1f24;--faint:#6a737d;--grid:#dfe3e8;--paper:#ffffff;\
--measured:#7fbfe6;--predicted:#b84a00;--band:#e9edf1}\
@media screen and (prefers-color-scheme:dark){.dynid-plot{--ink:#e6e8eb;--faint:#a0a8b2;--grid:#343a42;\
--paper:#15181c;--measured:#2f6f9c;--predicted:#ffa94d;--band:#262c33}}\
.dynid-plot .paper{fill:var(--paper)}.dynid-plot .band{fill:var(--band)}\
.dynid-plot text{fill:var(--ink)}.dynid-plot .tick{fill:var(--faint);font-size:11px}\
.dynid-plot .title{font-weight:600;font-size:13px}\
.dynid-plot .grid{stroke:var(--grid);stroke-width:1}.dynid-plot .frame{stroke:var(--faint);stroke-width:1;fill:none}\
.dynid-plot .measured{stroke:var(--measured);stroke-width:5;fill:none;stroke-linejoin:round}\
.dynid-plot .predicted{stroke:var(--predicted);stroke-width:1.4;fill:none;stroke-linejoin:round}\
.dynid-plot .curve{vector-effect:non-scaling-stroke}.dynid-plot .view{overflow:hidden}\
.dynid-plot .residual{stroke:var(--ink);stroke-width:1;fill:none}\
.dynid-plot{--hue0:#0072b2;--hue1:#b84a00;--hue2:#00775a;--hue3:#a8326f;--hue4:#7a5c00;--hue5:#3d3d3d}\
@media screen and (prefers-color-scheme:dark){.dynid-plot{--hue0:#56b4e9;--hue1:#ffa94d;--hue2:#3ecfa3;--hue3:#e79cc2;\
--hue4:#f0e442;--hue5:#d0d0d0}}\
.dynid-plot .line{fill:none;stroke-width:1.8;stroke-linejoin:round}.dynid-plot .floor{stroke:var(--faint);stroke-width:1.2;\
stroke-dasharray:2 4;fill:none}\
.dynid-plot .line.hue0{stroke:var(--hue0)}.dynid-plot .line.hue1{stroke:var(--hue1)}.dynid-plot .line.hue2{stroke:var(--hue2)}\
.dynid-plot .line.hue3{stroke:var(--hue3)}.dynid-plot .line.hue4{stroke:var(--hue4)}.dynid-plot .line.hue5{stroke:var(--hue5)}\
.dynid-plot .mark.hue0,.dynid-plot text.hue0{fill:var(--hue0)}.dynid-plot .mark.hue1,.dynid-plot text.hue1{fill:var(--hue1)}\
.dynid-plot .mark.hue2,.dynid-plot text.hue2{fill:var(--hue2)}.dynid-plot .mark.hue3,.dynid-plot text.hue3{fill:var(--hue3)}\
.dynid-plot .mark.hue4,.dynid-plot text.hue4{fill:var(--hue4)}.dynid-plot .mark.hue5,.dynid-plot text.hue5{fill:var(--hue5)}\
.dynid-plot .below{fill:var(--hue0)}.dynid-plot .above{fill:var(--hue1)}\
.dynid-plot .isoline{fill:none;stroke:var(--ink);stroke-width:.5;stroke-opacity:.55}";

/// What a picture on a page can do where scripts run: zoom and pan. It needs nothing but the page.
pub const SCRIPT: &str = include_str!("plot/zoom.js");

/// A picture that stands alone as an `.svg` file: all panels below each other.
pub fn standalone(panels: &[Panel]) -> String {
    stacked(panels.len(), panel_height(), |svg, index| draw(svg, &panels[index]))
}

/// Curves below each other, as an `.svg` file.
pub fn curves(curves: &[Curve]) -> String {
    stacked(curves.len(), TITLE + OVERLAY + FOOT, |svg, index| {
        let own = &curves[index];
        let _ = writeln!(svg, "<rect class=\"paper\" width=\"{WIDTH}\" height=\"{}\"/>", TITLE + OVERLAY + FOOT);
        let _ = writeln!(svg, "<text class=\"title\" x=\"{LEFT}\" y=\"20\">{}</text>", escaped(&own.title));
        let area = Area { top: TITLE, height: OVERLAY };
        let time = Axis::around(&[&own.time], 8, Margin::None);
        let values = Axis::around(&[&own.values], 6, Margin::Some);
        frame(svg, &area, &time, &values, &own.quantity);
        view(svg, &area, &values, |svg| curve(svg, "predicted", "", &area, &time, &values, &own.time, &own.values));
        foot(svg, &time, TITLE + OVERLAY);
    })
}

/// Pictures of one height below each other, as an `.svg` file.
fn stacked(count: usize, each: f64, draw: impl Fn(&mut String, usize)) -> String {
    let height = each * count as f64;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"dynid-plot\" viewBox=\"0 0 {WIDTH} {height}\" \
         width=\"{WIDTH}\" height=\"{height}\" role=\"img\">\n<style>{STYLE}</style>\n"
    );
    for index in 0..count {
        let _ = writeln!(svg, "<g transform=\"translate(0 {})\">", each * index as f64);
        draw(&mut svg, index);
        svg.push_str("</g>\n");
    }
    svg.push_str("</svg>\n");
    svg
}

/// A picture for a page that has [`STYLE`] in its head; with [`SCRIPT`] at its end it can be zoomed.
pub fn inline(panel: &Panel) -> String {
    on_page(&panel.title, &panel.time, panel_height(), |svg| draw(svg, panel))
}

/// The frame of a picture over time on a page.
fn on_page(title: &str, time: &[f64], height: f64, draw: impl Fn(&mut String)) -> String {
    let time = Axis::around(&[time], 8, Margin::None);
    let mut svg = format!(
        "<svg class=\"dynid-plot\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"{}\" \
         data-from=\"{}\" data-to=\"{}\">\n",
        escaped(title),
        time.from,
        time.to
    );
    draw(&mut svg);
    svg.push_str("</svg>\n");
    svg
}

/// A title that leaves room for the legend: the end of a long one, which tells runs of one folder apart.
fn shortened(title: &str) -> String {
    const ROOM: usize = 58;
    let length = title.chars().count();
    if length <= ROOM {
        return title.to_owned();
    }
    std::iter::once('\u{2026}').chain(title.chars().skip(length - ROOM + 1)).collect()
}

fn panel_height() -> f64 {
    TITLE + OVERLAY + GAP + RESIDUAL + FOOT
}

fn draw(svg: &mut String, panel: &Panel) {
    let residual: Vec<f64> = panel.measured.iter().zip(&panel.predicted).map(|(y, model)| y - model).collect();
    let time = Axis::around(&[&panel.time], 8, Margin::None);
    let upper = Axis::around(&[&panel.measured, &panel.predicted], 6, Margin::Some);
    let band = panel.noise_floor.map_or(0.0, |floor| 2.0 * floor);
    let lower = Axis::around(&[&residual, &[-band, band]], 5, Margin::Some);

    let _ = writeln!(svg, "<rect class=\"paper\" width=\"{WIDTH}\" height=\"{}\"/>", panel_height());
    let _ = writeln!(svg, "<text class=\"title\" x=\"{LEFT}\" y=\"20\">{}</text>", escaped(&shortened(&panel.title)));
    legend(svg);

    let top = Area { top: TITLE, height: OVERLAY };
    frame(svg, &top, &time, &upper, &format!("{} [{}]", panel.quantity, panel.unit));
    view(svg, &top, &upper, |svg| {
        curve(svg, "measured", "", &top, &time, &upper, &panel.time, &panel.measured);
        curve(svg, "predicted", "", &top, &time, &upper, &panel.time, &panel.predicted);
    });

    let bottom = Area { top: TITLE + OVERLAY + GAP, height: RESIDUAL };
    frame(svg, &bottom, &time, &lower, &format!("residual [{}]", panel.unit));
    view(svg, &bottom, &lower, |svg| {
        if band > 0.0 {
            let (high, low) = (bottom.y(&lower, band), bottom.y(&lower, -band));
            let _ = writeln!(
                svg,
                "<rect class=\"band\" x=\"0\" y=\"{high:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>",
                WIDTH - LEFT - RIGHT,
                low - high
            );
        }
        curve(svg, "residual", "", &bottom, &time, &lower, &panel.time, &residual);
    });

    foot(svg, &time, bottom.top + bottom.height);
}

/// The labels of the time axis below `y`.
fn foot(svg: &mut String, time: &Axis, y: f64) {
    foot_of(svg, time, y, "time [s]");
}

/// The labels of a horizontal axis below `y`.
fn foot_of(svg: &mut String, time: &Axis, y: f64, name: &str) {
    let _ = writeln!(svg, "<g class=\"foot\" data-y=\"{y}\">");
    for &tick in &time.ticks {
        let x = time.place(tick, LEFT, WIDTH - RIGHT);
        let label = time.label(tick);
        let _ = writeln!(
            svg,
            "<text class=\"tick\" x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{label}</text>",
            y + 15.0
        );
    }
    svg.push_str("</g>\n");
    let _ = writeln!(
        svg,
        "<text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
        0.5 * (LEFT + WIDTH - RIGHT),
        y + 31.0,
        escaped(name)
    );
}

fn legend(svg: &mut String) {
    let x = WIDTH - RIGHT - 190.0;
    let _ = writeln!(
        svg,
        "<path class=\"measured\" d=\"M{x} 16h22\"/><text x=\"{}\" y=\"20\">measured</text>\
         <path class=\"predicted\" d=\"M{} 16h22\"/><text x=\"{}\" y=\"20\">model</text>",
        x + 28.0,
        x + 104.0,
        x + 132.0
    );
}

/// A plot's place on the picture.
struct Area {
    top: f64,
    height: f64,
}

impl Area {
    /// From the area's own upper edge.
    fn y(&self, axis: &Axis, value: f64) -> f64 {
        axis.place(value, self.height, 0.0)
    }
}

/// What moves when the picture is zoomed: a picture within the picture, in the area's own coordinates.
fn view(svg: &mut String, place: &Area, values: &Axis, draw: impl FnOnce(&mut String)) {
    let (width, height, top) = (WIDTH - LEFT - RIGHT, place.height, place.top);
    let _ = writeln!(
        svg,
        "<svg class=\"view\" data-view=\"{top}\" data-low=\"{}\" data-high=\"{}\" data-margin=\"{MARGIN}\" x=\"{LEFT}\" \
         y=\"{top}\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" preserveAspectRatio=\"none\">",
        values.from, values.to
    );
    draw(svg);
    svg.push_str("</svg>\n");
}

fn frame(svg: &mut String, place: &Area, time: &Axis, values: &Axis, label: &str) {
    let right = WIDTH - RIGHT;
    let _ = writeln!(svg, "<g class=\"grid-of\" data-view=\"{}\">", place.top);
    for &tick in &values.ticks {
        let y = place.top + place.y(values, tick);
        let _ = writeln!(
            svg,
            "<path class=\"grid\" d=\"M{LEFT} {y:.1}H{right}\"/>\
             <text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            LEFT - 6.0,
            y + 4.0,
            values.label(tick)
        );
    }
    for &tick in &time.ticks {
        let x = time.place(tick, LEFT, right);
        let _ = writeln!(svg, "<path class=\"grid\" d=\"M{x:.1} {}v{}\"/>", place.top, place.height);
    }
    svg.push_str("</g>\n");
    let middle = place.top + 0.5 * place.height;
    let _ = writeln!(
        svg,
        "<rect class=\"frame\" x=\"{LEFT}\" y=\"{}\" width=\"{}\" height=\"{}\"/>\
         <text class=\"tick\" text-anchor=\"middle\" transform=\"translate(14 {middle:.1}) rotate(-90)\">{}</text>",
        place.top,
        right - LEFT,
        place.height,
        escaped(label)
    );
}

/// A curve in the coordinates of a [`view`]; `more` is further attributes.
#[expect(clippy::too_many_arguments, reason = "two signals with an axis each, in a place, in a style")]
fn curve(
    svg: &mut String,
    class: &str,
    more: &str,
    place: &Area,
    time: &Axis,
    axis: &Axis,
    times: &[f64],
    values: &[f64],
) {
    let points: Vec<(f64, f64)> = times
        .iter()
        .zip(values)
        .map(|(&t, &value)| (time.place(t, 0.0, WIDTH - LEFT - RIGHT), place.y(axis, value)))
        .collect();
    let mut path = String::new();
    // what is not a number leaves a gap
    for piece in points.split(|point| !point.1.is_finite()) {
        line_through(&mut path, &straightened(&thinned(piece)));
    }
    let _ = writeln!(svg, "<path class=\"{class} curve\"{more} d=\"{path}\"/>");
}

/// A line through `points` in tenths of pixels, each from the last: half the text that every place in full would take.
fn line_through(path: &mut String, points: &[(f64, f64)]) {
    let tenths = |value: f64| (10.0 * value).round() as i64;
    let mut places = points.iter().map(|&(x, y)| (tenths(x), tenths(y)));
    let Some(mut last) = places.next() else { return };
    path.push('M');
    tell_tenths(path, last.0, "");
    tell_tenths(path, last.1, " ");
    let mut separator = "l";
    for place in places {
        if place == last {
            continue;
        }
        tell_tenths(path, place.0 - last.0, separator);
        tell_tenths(path, place.1 - last.1, " ");
        (separator, last) = (" ", place);
    }
}

/// So many tenths, as short as can be, behind what separates them from the number before: a sign does so as well as a space.
fn tell_tenths(path: &mut String, tenths: i64, separator: &str) {
    let sign = if tenths < 0 { "-" } else { "" };
    path.push_str(if separator == " " && tenths < 0 { "" } else { separator });
    let _ = match (tenths.unsigned_abs() / 10, tenths.unsigned_abs() % 10) {
        (whole, 0) => write!(path, "{sign}{whole}"),
        (0, rest) => write!(path, "{sign}.{rest}"),
        (whole, rest) => write!(path, "{sign}{whole}.{rest}"),
    };
}

/// At most four points per half pixel: first, lowest, highest, last. The drawn line is the same, the file small.
fn thinned(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let column = |x: f64| (2.0 * x).floor();
    let mut kept = Vec::new();
    for group in points.chunk_by(|a, b| column(a.0) == column(b.0)) {
        let by_height = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let extremes = [group.first(), group.iter().min_by(by_height), group.iter().max_by(by_height), group.last()];
        let mut extremes: Vec<(f64, f64)> = extremes.into_iter().flatten().copied().collect();
        extremes.sort_by(|a, b| a.0.total_cmp(&b.0));
        extremes.dedup();
        kept.extend(extremes);
    }
    kept
}

/// Without points that a straight line between those kept passes as near as the written digits tell.
fn straightened(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    /// Pixels.
    const NEAR: f64 = 0.05;
    let mut kept: Vec<(f64, f64)> = points.first().into_iter().copied().collect();
    // Slopes of the lines from the last point kept that pass all points since.
    let mut slopes = (f64::NEG_INFINITY, f64::INFINITY);
    for pair in points.windows(2) {
        let (before, next) = (pair[0], pair[1]);
        let towards = |start: (f64, f64), height: f64| (next.1 + height - start.1) / (next.0 - start.0);
        let start = kept[kept.len() - 1];
        let slope = towards(start, 0.0);
        if next.0 > start.0 && slopes.0 <= slope && slope <= slopes.1 {
            slopes = (slopes.0.max(towards(start, -NEAR)), slopes.1.min(towards(start, NEAR)));
        } else {
            if before != start {
                kept.push(before);
            }
            slopes = if next.0 > before.0 {
                (towards(before, -NEAR), towards(before, NEAR))
            } else {
                // A vertical line: the next point is kept.
                (f64::INFINITY, f64::NEG_INFINITY)
            };
        }
    }
    if points.len() > 1 {
        kept.extend(points.last());
    }
    kept
}

#[derive(Clone, Copy, PartialEq)]
enum Margin {
    None,
    Some,
}

/// A range of values with round ticks in it.
struct Axis {
    from: f64,
    to: f64,
    ticks: Vec<f64>,
    decimals: usize,
}

impl Axis {
    fn around(values: &[&[f64]], n_ticks: usize, margin: Margin) -> Self {
        let finite = values.iter().flat_map(|values| values.iter()).copied().filter(|value| value.is_finite());
        let (mut from, mut to) =
            finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(from, to), value| (from.min(value), to.max(value)));
        if from > to {
            (from, to) = (0.0, 1.0);
        }
        if to - from <= 1e-12 * from.abs().max(to.abs()).max(1e-9) {
            let half = 0.5 * from.abs().max(1e-6);
            (from, to) = (from - half, to + half);
        }
        if margin == Margin::Some {
            let extra = MARGIN * (to - from);
            (from, to) = (from - extra, to + extra);
        }
        let step = round_step((to - from) / n_ticks as f64);
        let (first, last) = ((from / step).ceil() as i64, (to / step).floor() as i64);
        let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
        Self { from, to, ticks: (first..=last).map(|k| k as f64 * step).collect(), decimals }
    }

    fn place(&self, value: f64, start: f64, end: f64) -> f64 {
        start + (value - self.from) / (self.to - self.from) * (end - start)
    }

    fn label(&self, tick: f64) -> String {
        let text = format!("{tick:.*}", self.decimals);
        if text.trim_start_matches('-').bytes().all(|byte| byte == b'0' || byte == b'.') {
            text.trim_start_matches('-').to_owned()
        } else {
            text.replace('-', "\u{2212}")
        }
    }
}

/// 1, 2 or 5 times a power of ten, not below `rough`.
fn round_step(rough: f64) -> f64 {
    let power = 10_f64.powf(rough.log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power).into_iter().find(|step| *step >= rough).unwrap_or(10.0 * power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let axis = Axis::around(&[&[-0.31, 0.44]], 5, Margin::None);
        let labels: Vec<String> = axis.ticks.iter().map(|&tick| axis.label(tick)).collect();
        assert_eq!(labels, ["\u{2212}0.2", "0.0", "0.2", "0.4"]);
    }

    #[test]
    fn long_titles_leave_room_for_the_legend() {
        assert_eq!(shortened("run.csv, joint 4"), "run.csv, joint 4");
        let long = shortened(&format!("{}/run.csv, joint 4", "folder".repeat(30)));
        assert!(
            long.chars().count() == 58 && long.starts_with('\u{2026}') && long.ends_with("/run.csv, joint 4"),
            "{long}"
        );
    }

    #[test]
    fn constant_and_empty_signals_have_an_axis() {
        for values in [&[][..], &[0.0, 0.0], &[2.5, 2.5], &[f64::NAN]] {
            let axis = Axis::around(&[values], 5, Margin::Some);
            assert!(axis.from < axis.to && !axis.ticks.is_empty(), "{values:?}");
        }
    }

    #[test]
    fn thinning_keeps_ends_and_extremes() {
        let points: Vec<(f64, f64)> = (0..10_000).map(|k| (f64::from(k) * 1e-2, f64::from(k % 7))).collect();
        let kept = thinned(&points);
        assert!(kept.len() < 1_000, "{}", kept.len());
        assert_eq!((kept.first(), kept.last()), (points.first(), points.last()));
        let highest = |points: &[(f64, f64)]| points.iter().fold(0.0_f64, |high, point| high.max(point.1));
        assert_eq!(highest(&kept), highest(&points));
    }

    #[test]
    fn straightening_moves_no_point_visibly() {
        let wave: Vec<(f64, f64)> =
            (0..3_000).map(|k| f64::from(k) * 0.2).map(|x| (x, 40.0 * (x / 50.0).sin())).collect();
        let kept = straightened(&wave);
        assert!(kept.len() < 300, "{}", kept.len());
        assert_eq!((kept.first(), kept.last()), (wave.first(), wave.last()));
        for (x, y) in wave {
            let after = kept.iter().position(|point| point.0 >= x).unwrap().max(1);
            let (one, other) = (kept[after - 1], kept[after]);
            let line = one.1 + (other.1 - one.1) * (x - one.0) / (other.0 - one.0);
            assert!((line - y).abs() <= 0.1, "{x}: {line} and {y}");
        }
        let steps = [(0.0, 0.0), (1.0, 0.0), (1.0, 5.0), (1.0, 2.0), (2.0, 2.0), (3.0, 2.0)];
        assert_eq!(straightened(&steps), [(0.0, 0.0), (1.0, 0.0), (1.0, 5.0), (1.0, 2.0), (3.0, 2.0)]);
    }

    #[test]
    fn a_line_is_written_in_tenths_of_pixels_from_place_to_place() {
        let mut path = String::new();
        line_through(&mut path, &[(0.0, 1.04), (0.5, 0.46), (0.5, 0.5), (1.2, 0.5), (1.0, 12.0)]);
        assert_eq!(path, "M0 1l.5-.5 .7 0-.2 11.5");
        path.clear();
        line_through(&mut path, &[(3.0, 4.04), (3.0, 4.0)]);
        assert_eq!(path, "M3 4", "a line without length");
    }

    #[test]
    fn what_is_not_a_number_leaves_a_gap() {
        let values = vec![0.0, 1.0, f64::NAN, 2.0, 1.0];
        let time = (0..5).map(f64::from).collect();
        let panel = Panel { time, measured: values.clone(), predicted: values, ..Panel::default() };
        let svg = inline(&panel);
        let measured = svg.lines().rfind(|line| line.starts_with("<path class=\"measured ")).unwrap();
        assert_eq!(measured.matches('M').count(), 2, "{measured}");
        assert!(!svg.contains("NaN"));
    }

    #[test]
    fn names_cannot_break_the_picture() {
        let panel = Panel { title: "a<b & \"c\"".to_owned(), ..Panel::default() };
        let svg = standalone(&[panel]);
        assert!(svg.contains("a&lt;b &amp; &quot;c&quot;") && !svg.contains("a<b"));
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
    }

    #[test]
    fn same_panel_same_text() {
        let panel = Panel {
            title: "run, joint 0".to_owned(),
            quantity: "position".to_owned(),
            unit: "rad".to_owned(),
            time: (0..500).map(|k| f64::from(k) * 0.01).collect(),
            measured: (0..500).map(|k| (f64::from(k) * 0.02).sin()).collect(),
            predicted: (0..500).map(|k| (f64::from(k) * 0.02).sin() * 0.99).collect(),
            noise_floor: Some(1e-3),
        };
        assert_eq!(standalone(std::slice::from_ref(&panel)), standalone(&[panel]));
    }
}
