//! Traces, drawn in as many columns as a picture has.

use std::sync::{Arc, OnceLock};

use serde::Deserialize;
use serde_json::{Value, json};

use super::pyramid::Pyramid;

/// Columns of a picture at most.
const WIDEST: usize = 20_000;

/// A signal over time.
pub struct Trace {
    t: Arc<Vec<f64>>,
    values: Vec<f64>,
    /// Made when it is first drawn.
    pyramid: OnceLock<Pyramid>,
}

/// The part of a trace that is drawn, and how finely.
#[derive(Deserialize, Clone, Copy)]
pub struct Window {
    from: Option<f64>,
    to: Option<f64>,
    width: usize,
}

impl Trace {
    /// Both have one entry a sample.
    pub fn new(t: Arc<Vec<f64>>, values: Vec<f64>) -> Self {
        Self { t, values, pyramid: OnceLock::new() }
    }

    /// The trace in a window: of each column its time, its smallest and its largest value. Of few samples each is a column.
    pub fn columns(&self, name: &str, window: Window) -> Value {
        let (t, values) = (&self.t, &self.values);
        // One sample beyond either end, so that lines go to the edge.
        let first = window.from.map_or(0, |from| t.partition_point(|t| *t < from).saturating_sub(1));
        let end = window.to.map_or(t.len(), |to| t.partition_point(|t| *t <= to) + 1).clamp(first, t.len());
        let (n, width) = (end - first, window.width.clamp(1, WIDEST));
        if n <= width {
            let values = &values[first..end];
            return json!({ "name": name, "t": t[first..end], "low": values, "high": values });
        }
        let pyramid = self.pyramid.get_or_init(|| Pyramid::of(values));
        let columns = (0..width).map(|column| first + n * column / width..first + n * (column + 1) / width);
        let middle: Vec<f64> = columns.clone().map(|range| t[usize::midpoint(range.start, range.end)]).collect();
        let (low, high): (Vec<f64>, Vec<f64>) =
            columns.map(|range| pyramid.extremes(values, range)).map(|[low, high]| (low, high)).unzip();
        json!({ "name": name, "t": middle, "low": low, "high": high })
    }
}
