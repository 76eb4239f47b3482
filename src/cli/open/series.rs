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

    /// Its values (bytes); the times are shared.
    pub fn bytes(&self) -> usize {
        self.values.len() * size_of::<f64>()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_is_null() {
        let t: Vec<f64> = (0..100).map(f64::from).collect();
        let values = (0..100).map(|k| if k < 50 { f64::NAN } else { f64::from(k) }).collect();
        let trace = Trace::new(Arc::new(t), values);
        let text = |width: usize| trace.columns("q0", Window { from: None, to: None, width }).to_string();
        assert_eq!(text(2), r#"{"high":[null,99.0],"low":[null,50.0],"name":"q0","t":[25.0,75.0]}"#);
        assert!(text(100).contains("null,50.0,51.0"), "{}", text(100));
    }

    #[test]
    fn a_window_goes_one_sample_beyond_either_edge() {
        let t: Vec<f64> = (0..100).map(f64::from).collect();
        let trace = Trace::new(Arc::new(t.clone()), t);
        let drawn = trace.columns("q0", Window { from: Some(9.5), to: Some(12.0), width: 50 });
        assert_eq!(drawn["t"], json!([9.0, 10.0, 11.0, 12.0, 13.0]));
        let outside = trace.columns("q0", Window { from: Some(500.0), to: Some(400.0), width: 50 });
        assert_eq!(outside["t"], json!([99.0]));
    }
}
