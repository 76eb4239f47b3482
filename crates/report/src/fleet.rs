//! A fleet on one page: what has changed on which robot, and since when.

use std::fmt::Write;

use dynid_fleet::{Analysis, Change, Series, Shape};
use dynid_sentences::fleet::{event, lacking, stray, unlike, verdict};

use crate::plot::nights::{Nights, inline};
use crate::{Part, Section, prose};

/// All that an analysis says, as sections of a page; `unit` knows the units of quantities, as far as they have one.
pub fn fleet_sections(analysis: &Analysis, unit: &dyn Fn(&str) -> String) -> Vec<Box<dyn Section>> {
    let mut sections: Vec<Box<dyn Section>> = Vec::new();
    let mut add = |title: &'static str, html: String| sections.push(Box::new(Part { title, html }));
    add(
        "Verdict",
        format!(
            "<p>{}</p>\n<p class=\"note\">{} looks were taken, and each counts. Bars are standard errors of the fits; the orange line is \
             what explains the estimates; the shaded nights are those in which the change may have begun (95 %); dotted lines \
             hold the middle half of the other robots. What all robots do alike is taken out.</p>\n",
            prose(&verdict(analysis)),
            analysis.looks
        ),
    );
    let mut changed = String::new();
    for own in analysis.events() {
        let _ = writeln!(changed, "<h3>{}</h3>", prose(&event(&own)));
        own.changes.iter().for_each(|change| changed.push_str(&figure(analysis, change, unit)));
    }
    if !changed.is_empty() {
        add("What has changed", changed);
    }
    let list = |lines: Vec<String>| {
        let items: String = lines.iter().map(|line| format!("<li>{}</li>\n", prose(line))).collect();
        format!("<ul>\n{items}</ul>\n")
    };
    let strays: Vec<String> = analysis.changes.iter().filter(|own| own.shape == Shape::Stray).map(stray).collect();
    for (title, lines) in [
        ("Robots unlike the others", analysis.unlike.iter().map(unlike).collect::<Vec<_>>()),
        ("What a robot's model lacks and the others have", analysis.lacking.iter().map(lacking).collect()),
        ("Nights that stand alone", strays),
    ] {
        if !lines.is_empty() {
            add(title, list(lines));
        }
    }
    sections
}

fn figure(analysis: &Analysis, change: &Change, unit: &dyn Fn(&str) -> String) -> String {
    let of_quantity = || analysis.series.iter().filter(|own| own.quantity == change.quantity);
    let Some(series) = of_quantity().find(|own| own.robot == change.robot) else { return String::new() };
    let all: Vec<&Change> = analysis
        .changes
        .iter()
        .filter(|own| own.robot == change.robot && own.quantity == change.quantity && own.shape != Shape::Stray)
        .collect();
    let unit = unit(&change.quantity);
    let picture = Nights {
        title: format!("{}: {}", change.robot, change.quantity),
        quantity: if unit.is_empty() { String::new() } else { format!("[{unit}]") },
        nights: analysis.nights.clone(),
        estimates: (0..series.len()).map(|k| (series.nights[k], series.values[k], series.std_errors[k])).collect(),
        explained: explained(series, &all),
        since: Some(change.between),
        others: middle_half(of_quantity().filter(|own| own.robot != change.robot)),
    };
    format!("<figure>{}</figure>\n", inline(&picture))
}

/// The value that all lasting changes of a quantity make of each of its nights; the first change knows the level before it.
fn explained(series: &Series, changes: &[&Change]) -> Vec<(usize, f64)> {
    let Some(first) = changes.iter().min_by_key(|own| own.index) else { return Vec::new() };
    let added = |night: usize| -> f64 {
        let since = |own: &Change| if night < own.index { 0.0 } else { (night - own.index) as f64 };
        let of = |own: &&Change| match own.shape {
            Shape::Step if night >= own.index => own.by,
            Shape::Drift => own.by * since(own),
            Shape::Step | Shape::Stray => 0.0,
        };
        changes.iter().map(of).sum()
    };
    let before =
        first.from - if first.shape == Shape::Drift { added(first.index) } else { added(first.index) - first.by };
    series.nights.iter().map(|night| (*night, before + added(*night))).collect()
}

/// Between the quarters of the robots' middles, where there are robots enough.
fn middle_half<'a>(others: impl Iterator<Item = &'a Series>) -> Option<[f64; 2]> {
    let mut middles: Vec<f64> = others
        .map(|own| {
            let mut values = own.values.clone();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        })
        .collect();
    middles.sort_by(f64::total_cmp);
    (middles.len() >= 4).then(|| [middles[middles.len() / 4], middles[3 * middles.len() / 4]])
}
