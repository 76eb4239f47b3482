//! Results for people: pages in HTML and pictures in SVG.
//!
//! [`page`] builds every page from [`Section`]s; a section is HTML below a heading. [`plot`] draws. A page opens with no network:
//! no font, script, style or picture comes from anywhere but the page itself. [`plot::SCRIPT`] (zoom and pan) is on a page that
//! has pictures which need it.
//!
//! [`Ranking`] reads the JSON of `dynid diagnose` and leaves out what it does not find there. [`WallReport`] and [`SpaceReport`]
//! play walls under a setting's hands and make sections of the results; the first wall is what the others are compared with.
//! Torque surfaces are evaluated at the peaks of the fuzzy sets and on both sides of the wall's surface, where the torque bends
//! and jumps, and only for laws without memory.

mod diagnosis;
mod findings;
mod fleet;
mod ladder;
mod models;
mod overlay;
pub mod plot;
mod sections;
mod sheet;
mod space;
mod wall;

use std::fmt::Write;

pub use diagnosis::{Ranking, placed, sentences};
pub use findings::{TorqueTerms, Where};
pub use fleet::fleet_sections;
pub use ladder::{LadderSection, changes, ladder_pictures};
pub use models::{Accuracy, Budget, Cell, Models, ModelsRow, Standing};
pub use overlay::{ShownErrors, panels, run_panels};
pub use sections::{Errors, Figures, ParameterRow, Parameters, Provenance, Sentences, Verdict};
pub use sheet::{DataQuality, Sheet};
pub use space::{SpaceReport, carried_in_words};
pub use wall::{WallReport, WallReportError, damping_in_words};

pub(crate) use dynid_format::{escaped, number};

/// A part of the page.
pub trait Section {
    /// Its heading.
    fn title(&self) -> &str;
    /// What stands below the heading.
    fn html(&self) -> String;
}

/// A section that is ready.
struct Part {
    title: &'static str,
    html: String,
}

impl Section for Part {
    fn title(&self) -> &str {
        self.title
    }

    fn html(&self) -> String {
        self.html.clone()
    }
}

const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#1b1f24;--faint:#57606a;--line:#d5dae0;--paper:#ffffff;--good:#0a6b3d;--bad:#a33c00}\
@media screen and (prefers-color-scheme:dark){:root{--ink:#e6e8eb;--faint:#a0a8b2;--line:#343a42;--paper:#15181c;\
--good:#5cc98f;--bad:#ffa94d}}\
body{font:15px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--paper);max-width:64rem;margin:2rem auto;\
padding:0 1rem}\
h1{font-size:1.5rem;line-height:1.25;margin:0 0 1rem}h2{font-size:1.1rem;margin:2.2rem 0 .6rem}\
p{margin:.5rem 0}.note{color:var(--faint);font-size:.9rem}\
.wide{overflow-x:auto}table{border-collapse:collapse;font-size:.92rem;font-variant-numeric:tabular-nums;width:100%}\
th,td{padding:.22rem .45rem;border-bottom:1px solid var(--line);text-align:right;white-space:nowrap}\
th{color:var(--faint);font-weight:600}th.word,td.word{text-align:left}\
.faint{color:var(--faint)}.good{color:var(--good)}.bad{color:var(--bad)}code{font:.9em ui-monospace,monospace}\
figure{margin:1rem 0}figure svg{width:100%;height:auto;display:block}\
dl{display:grid;grid-template-columns:max-content 1fr;gap:.2rem 1rem}dt{color:var(--faint)}\
dd{margin:0;overflow-wrap:anywhere}\
h3{font-size:1rem;margin:1.2rem 0 .3rem}ul{margin:.2rem 0;padding-left:1.2rem}summary{cursor:pointer;margin:.6rem 0}\
.columns{display:grid;grid-template-columns:repeat(auto-fit,minmax(16rem,1fr));gap:0 2rem}\
.pictures{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(26rem,100%),1fr));gap:0 1.5rem}\
.pictures figure{margin:.5rem 0}table.rules td{padding:.2rem .35rem}table.rules td.core{outline:1px solid var(--faint)}\
table.prose td{vertical-align:top}table.prose td:last-child{white-space:normal;min-width:12rem}\
.bar{position:relative;display:inline-block;width:5rem;height:.8rem;background:var(--line)}\
.bar span{position:absolute;left:0;top:0;bottom:0;background:#0072b2}\
.bar i{position:absolute;top:-.15rem;bottom:-.15rem;width:2px;background:var(--ink)}\
.zoom-buttons{display:flex;gap:.3rem;justify-content:flex-end}.zoom-buttons button{font:inherit;min-width:2rem;padding:.1rem .4rem;\
color:var(--ink);background:var(--paper);border:1px solid var(--line);border-radius:.25rem;cursor:pointer}\
pre{overflow-x:auto;font:.85em/1.5 ui-monospace,monospace;margin:.5rem 0;white-space:pre-wrap;overflow-wrap:anywhere}\
@media screen{figure{overflow-x:auto}figure svg.dynid-plot{min-width:36rem}figure svg.half{min-width:0}}\
@media print{body{margin:0;max-width:none;font-size:10pt}figure,tr,h2,h3{break-inside:avoid}h2,h3{break-after:avoid}\
.wide{overflow:visible}.pictures{grid-template-columns:1fr 1fr}table{font-size:7.5pt}th,td{padding:.1rem .25rem}.zoom-buttons{display:none}\
.bar,.bar *,table.rules td{print-color-adjust:exact;-webkit-print-color-adjust:exact}}";

/// The page.
pub fn page(title: &str, sections: &[&dyn Section]) -> String {
    let title = escaped(title);
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n\
         <style>{STYLE}\n{}</style>\n</head>\n<body>\n<h1>{title}</h1>\n",
        plot::STYLE
    );
    for section in sections {
        let _ = write!(html, "<section>\n<h2>{}</h2>\n{}</section>\n", escaped(section.title()), section.html());
    }
    if html.contains("<svg class=\"view\"") {
        let _ = write!(html, "<script>\n{}</script>\n", plot::SCRIPT);
    }
    html.push_str("</body>\n</html>\n");
    html
}

/// A sentence as HTML: what stands between backticks, as names do, is set as code.
fn prose(sentence: &str) -> String {
    let escaped = escaped(sentence);
    let parts: Vec<&str> = escaped.split('`').collect();
    // Where one has no other, nobody knows which: all stay as they are.
    if parts.len().is_multiple_of(2) {
        return escaped;
    }
    let set = |(index, part): (usize, &&str)| match index % 2 {
        0 => (*part).to_owned(),
        _ => format!("<code>{part}</code>"),
    };
    parts.iter().enumerate().map(set).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_between_backticks_are_set_as_code() {
        assert_eq!(prose("`a<b` or `c` at 4"), "<code>a&lt;b</code> or <code>c</code> at 4");
        assert_eq!(prose("a ` alone"), "a ` alone");
        assert_eq!(prose("`a` and ` alone"), "`a` and ` alone");
        assert_eq!(prose("plain"), "plain");
    }

    #[test]
    fn page_refers_to_nothing_outside_itself() {
        let verdict = Verdict { sentences: vec!["The <model> explains the log.".to_owned()] };
        let figures = Figures { title: "Where".to_owned(), panels: vec![plot::Panel::default()], note: String::new() };
        let html = page("A & B", &[&verdict, &figures]);
        assert!(html.contains("<script>"), "pictures can be zoomed");
        for outside in ["http", "src=", "href=", "@import", "url(", "import "] {
            assert!(!html.contains(outside), "{outside} in the page");
        }
        assert!(html.contains("The &lt;model&gt; explains"));
    }
}
