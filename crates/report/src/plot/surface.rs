//! A quantity over two others: bands of colour between isolines, blue below zero, vermilion above, none around it.
//!
//! A band further from zero is one more translucent layer of its hue, so that the picture keeps its order on white and on
//! black paper alike.

use std::fmt::Write;

use super::{Axis, Margin, escaped, round_step};

/// Values on a grid, linear between its points.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Surface {
    /// What it shows.
    pub title: String,
    /// What the horizontal axis shows, with its unit.
    pub along: String,
    /// What the vertical axis shows, with its unit.
    pub up: String,
    /// What the colours show, with its unit.
    pub quantity: String,
    /// Where the grid's columns stand, ascending.
    pub x: Vec<f64>,
    /// Where its rows stand, ascending.
    pub y: Vec<f64>,
    /// One row after the other.
    pub values: Vec<f64>,
}

const WIDTH: f64 = 420.0;
const LEFT: f64 = 56.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 32.0;
const HEIGHT: f64 = 210.0;
const FOOT: f64 = 92.0;
/// How much of the paper the outermost band hides.
const DEEPEST: f64 = 0.92;

/// A picture for a page that has [`super::STYLE`] in its head.
pub fn inline(surface: &Surface) -> String {
    let height = TOP + HEIGHT + FOOT;
    let mut svg = format!(
        "<svg class=\"dynid-plot half\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"{0}\">\n\
         <rect class=\"paper\" width=\"{WIDTH}\" height=\"{height}\"/>\n<text class=\"title\" x=\"{LEFT}\" y=\"20\">{0}</text>\n",
        escaped(&surface.title)
    );
    let is_whole = surface.values.len() == surface.x.len() * surface.y.len();
    if surface.x.len() > 1 && surface.y.len() > 1 && is_whole {
        draw(&mut svg, surface);
    }
    svg.push_str("</svg>\n");
    svg
}

fn draw(svg: &mut String, surface: &Surface) {
    let across = Axis::around(&[&surface.x], 6, Margin::None);
    let up = Axis::around(&[&surface.y], 6, Margin::None);
    let right = WIDTH - RIGHT;
    let bottom = TOP + HEIGHT;
    let xs: Vec<f64> = surface.x.iter().map(|x| across.place(*x, LEFT, right)).collect();
    let ys: Vec<f64> = surface.y.iter().map(|y| up.place(*y, bottom, TOP)).collect();
    let levels = levels(&surface.values);
    for (hue, sign) in [("below", -1.0), ("above", 1.0)] {
        for (index, level) in levels.iter().enumerate() {
            let heights: Vec<f64> = surface.values.iter().map(|value| sign * value - level).collect();
            let (fill, line) = region(&xs, &ys, &heights);
            if fill.is_empty() {
                break;
            }
            let _ = writeln!(
                svg,
                "<path class=\"{hue}\" fill-opacity=\"{:.3}\" d=\"{fill}\"/>\n<path class=\"isoline\" d=\"{line}\"/>",
                layer(index, levels.len())
            );
        }
    }
    let _ = writeln!(
        svg,
        "<rect class=\"frame\" x=\"{LEFT}\" y=\"{TOP}\" width=\"{}\" height=\"{HEIGHT}\"/>",
        right - LEFT
    );
    for tick in &across.ticks {
        let x = across.place(*tick, LEFT, right);
        let _ = writeln!(
            svg,
            "<path class=\"frame\" d=\"M{x:.1} {bottom}v4\"/><text class=\"tick\" x=\"{x:.1}\" y=\"{}\" \
             text-anchor=\"middle\">{}</text>",
            bottom + 16.0,
            across.label(*tick)
        );
    }
    for tick in &up.ticks {
        let y = up.place(*tick, bottom, TOP);
        let _ = writeln!(
            svg,
            "<path class=\"frame\" d=\"M{LEFT} {y:.1}h-4\"/><text class=\"tick\" x=\"{}\" y=\"{:.1}\" \
             text-anchor=\"end\">{}</text>",
            LEFT - 7.0,
            y + 4.0,
            up.label(*tick)
        );
    }
    let _ = writeln!(
        svg,
        "<text class=\"tick\" x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>\
         <text class=\"tick\" text-anchor=\"middle\" transform=\"translate(14 {:.1}) rotate(-90)\">{}</text>",
        0.5 * (LEFT + right),
        bottom + 32.0,
        escaped(&surface.along),
        TOP + 0.5 * HEIGHT,
        escaped(&surface.up)
    );
    legend(svg, surface, &levels);
}

/// Distances from zero at which a band begins, the same on both sides.
fn levels(values: &[f64]) -> Vec<f64> {
    let largest = values.iter().filter(|value| value.is_finite()).fold(0.0_f64, |most, value| most.max(value.abs()));
    if largest <= 0.0 {
        return Vec::new();
    }
    let step = round_step(largest / 10.0);
    (1..).map(|k| f64::from(k) * step).take_while(|level| *level < largest * (1.0 - 1e-9)).collect()
}

/// How much of the paper the bands from zero to this one hide together.
fn hidden(index: usize, count: usize) -> f64 {
    DEEPEST * (index + 1) as f64 / count as f64
}

/// The opacity of this layer, on those before it.
fn layer(index: usize, count: usize) -> f64 {
    let before = index.checked_sub(1).map_or(0.0, |before| hidden(before, count));
    (hidden(index, count) - before) / (1.0 - before)
}

/// Where heights are not below zero, as one path, and the line along which they are zero.
fn region(xs: &[f64], ys: &[f64], heights: &[f64]) -> (String, String) {
    let (mut fill, mut line) = (String::new(), String::new());
    let columns = xs.len();
    for row in 0..ys.len() - 1 {
        let (y0, y1) = (ys[row], ys[row + 1]);
        // Whole cells beside each other are one rectangle.
        let mut begun: Option<f64> = None;
        for column in 0..columns {
            let corner = |down: usize, across: usize| heights[(row + down) * columns + column + across];
            let is_whole = column + 1 < columns
                && [corner(0, 0), corner(0, 1), corner(1, 1), corner(1, 0)].iter().all(|height| *height >= 0.0);
            if is_whole {
                begun.get_or_insert(xs[column]);
                continue;
            }
            if let Some(from) = begun.take() {
                let _ = write!(fill, "M{from:.1} {y0:.1}H{:.1}V{y1:.1}H{from:.1}z", xs[column]);
            }
            if column + 1 == columns {
                break;
            }
            let (x0, x1) = (xs[column], xs[column + 1]);
            let corners =
                [(x0, y0, corner(0, 0)), (x1, y0, corner(0, 1)), (x1, y1, corner(1, 1)), (x0, y1, corner(1, 0))];
            let (inside, crossings) = clipped(&corners);
            for (index, (x, y)) in inside.iter().enumerate() {
                let _ = write!(fill, "{}{x:.1} {y:.1}", if index == 0 { 'M' } else { 'L' });
            }
            if !inside.is_empty() {
                fill.push('z');
            }
            for pair in crossings.chunks_exact(2) {
                let _ = write!(line, "M{:.1} {:.1}L{:.1} {:.1}", pair[0].0, pair[0].1, pair[1].0, pair[1].1);
            }
        }
    }
    (fill, line)
}

type Points = Vec<(f64, f64)>;

/// The part of a cell where the height is not below zero, and where its border is crossed.
fn clipped(corners: &[(f64, f64, f64); 4]) -> (Points, Points) {
    let (mut inside, mut crossings) = (Points::new(), Points::new());
    for (index, &(x, y, height)) in corners.iter().enumerate() {
        let (next_x, next_y, next) = corners[(index + 1) % 4];
        if height >= 0.0 {
            inside.push((x, y));
        }
        if (height >= 0.0) != (next >= 0.0) {
            let share = height / (height - next);
            let point = (x + share * (next_x - x), y + share * (next_y - y));
            inside.push(point);
            crossings.push(point);
        }
    }
    (inside, crossings)
}

/// The bands from the lowest to the highest, and the numbers between them.
fn legend(svg: &mut String, surface: &Surface, levels: &[f64]) {
    let n = levels.len();
    let y = TOP + HEIGHT + 44.0;
    let each = (WIDTH - LEFT - RIGHT) / (2 * n + 1) as f64;
    let step = levels.first().copied().unwrap_or(1.0);
    let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    // So many swatches apart that numbers do not touch.
    let apart = (34.0 / each).ceil().max(1.0) as usize;
    for swatch in 0..=2 * n {
        let x = LEFT + each * swatch as f64;
        let from_zero = swatch.abs_diff(n);
        let hue = if swatch < n { "below" } else { "above" };
        let opacity = from_zero.checked_sub(1).map_or(0.0, |index| hidden(index, n));
        let _ = writeln!(
            svg,
            "<rect class=\"{hue}\" fill-opacity=\"{opacity:.3}\" x=\"{x:.2}\" y=\"{y}\" width=\"{each:.2}\" height=\"11\"/>"
        );
        // Each number stands at the border of its band that is nearer to zero.
        if from_zero > 0 && from_zero % apart == 0 {
            let (border, sign) = if swatch < n { (x + each, "\u{2212}") } else { (x, "") };
            let _ = writeln!(
                svg,
                "<path class=\"frame\" d=\"M{border:.2} {y}v14\"/><text class=\"tick\" x=\"{border:.1}\" y=\"{}\" \
                 text-anchor=\"middle\">{sign}{:.decimals$}</text>",
                y + 25.0,
                levels[from_zero - 1]
            );
        }
    }
    let _ = writeln!(
        svg,
        "<rect class=\"frame\" x=\"{LEFT}\" y=\"{y}\" width=\"{}\" height=\"11\"/>\
         <text class=\"tick\" x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
        WIDTH - LEFT - RIGHT,
        0.5 * (LEFT + WIDTH - RIGHT),
        y + 40.0,
        escaped(&surface.quantity)
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The area of the polygons of a path of `M`, `L`, `H`, `V` and `z`.
    fn area(path: &str) -> f64 {
        let mut sum = 0.0;
        for polygon in path.split('z').filter(|polygon| !polygon.is_empty()) {
            let mut points: Vec<(f64, f64)> = Vec::new();
            let starts: Vec<usize> =
                polygon.match_indices(|c: char| c.is_ascii_uppercase()).map(|(at, _)| at).collect();
            for (index, start) in starts.iter().enumerate() {
                let end = starts.get(index + 1).copied().unwrap_or(polygon.len());
                let (kind, rest) = polygon[*start..end].split_at(1);
                let numbers: Vec<f64> = rest.split(' ').map(|number| number.parse().unwrap()).collect();
                let last = points.last().copied().unwrap_or_default();
                points.push(match kind {
                    "H" => (numbers[0], last.1),
                    "V" => (last.0, numbers[0]),
                    _ => (numbers[0], numbers[1]),
                });
            }
            let twice: f64 = (0..points.len())
                .map(|k| (points[k], points[(k + 1) % points.len()]))
                .map(|(a, b)| a.0 * b.1 - b.0 * a.1)
                .sum();
            sum += 0.5 * twice.abs();
        }
        sum
    }

    #[test]
    fn a_region_of_a_plane_has_the_area_that_it_has() {
        let xs: Vec<f64> = (0..=20).map(|k| f64::from(k) * 10.0).collect();
        let ys: Vec<f64> = (0..=10).map(|k| f64::from(k) * 10.0).collect();
        // x + 2 y >= 150 over 200 x 100: all but a trapezoid of heights 75 at x = 0 and 0 at x = 150
        let heights: Vec<f64> = ys.iter().flat_map(|y| xs.iter().map(move |x| x + 2.0 * y - 150.0)).collect();
        let (fill, line) = region(&xs, &ys, &heights);
        assert!((area(&fill) - (200.0 * 100.0 - 0.5 * 75.0 * 150.0)).abs() < 5.0, "{}", area(&fill));
        let length: f64 = line
            .split('M')
            .filter(|piece| !piece.is_empty())
            .map(|piece| {
                let numbers: Vec<f64> = piece.split(['L', ' ']).map(|number| number.parse().unwrap()).collect();
                (numbers[2] - numbers[0]).hypot(numbers[3] - numbers[1])
            })
            .sum();
        assert!((length - 75.0_f64.hypot(150.0)).abs() < 0.5, "{length}");
    }

    #[test]
    fn layers_add_up_to_even_steps() {
        let mut paper = 1.0;
        for index in 0..7 {
            paper *= 1.0 - layer(index, 7);
            assert!((1.0 - paper - hidden(index, 7)).abs() < 1e-12);
        }
    }

    #[test]
    fn bands_are_round_and_even_about_zero() {
        assert_eq!(levels(&[0.3, -1.0]).len(), 9);
        assert!((levels(&[0.3, -1.0])[1] - 0.2).abs() < 1e-15);
        assert!(levels(&[0.0, f64::NAN]).is_empty());
        let flat = Surface { x: vec![0.0, 1.0], y: vec![0.0, 1.0], values: vec![0.0; 4], ..Surface::default() };
        for surface in [flat, Surface::default()] {
            let svg = inline(&surface);
            assert!(svg.ends_with("</svg>\n") && !svg.contains("NaN"));
        }
    }

    #[test]
    fn names_cannot_break_the_picture() {
        let svg = inline(&Surface {
            title: "<b>".to_owned(),
            quantity: "\"&".to_owned(),
            x: vec![0.0, 1.0],
            y: vec![0.0, 1.0],
            values: vec![-1.0, 0.0, 1.0, 2.0],
            ..Surface::default()
        });
        assert!(svg.contains("&lt;b&gt;") && svg.contains("&quot;&amp;") && !svg.contains("<b>"));
    }
}
