// Check: what the logs answer, as a list that turns green, and whether a fit can be had.

import { button, command, digits, h, line, noExperiment, note, prose, table, number, waiting } from "./dom.js";
import { alike, current, detail, file, files, fresh, isCurrent, isOver, last, option, start, stem, unused, work } from "./server.js";
import { about, departure, state } from "./state.js";

const same = (args) => alike(about("check"))(args);

const item = (kind, title, ...more) => h("li", { class: `item ${kind}` },
    h("span", { class: "mark", "aria-hidden": "true" }, { good: "✓", bad: "✗", open: "?" }[kind]),
    h("div", {}, h("strong", {}, title), h("span", { class: "unseen" }, { good: ": yes", bad: ": no", open: ": open" }[kind]), more));

/** A command that is offered as a remedy, with a button that runs it. */
function remedy(args) {
    const as = (name) => args.map((own, index) => (args[index - 1] === "--out" ? name(own) : own));
    return h("div", { class: "remedy" }, command(line(as(unused))), button("Write this file", () => work(as(fresh))));
}

function list(result) {
    const all = result.quality.length;
    const questions = result.questions.map(({ question, what, runs }) => {
        const own = result.findings.filter((finding) => finding.question === question);
        const where = runs < all && !own.length ? h("p", {}, runs ? `Asked of ${runs} of ${all} runs.` : "Not asked: no run says anything of it.") : null;
        return item(own.length ? "bad" : runs ? "good" : "open", what, where, own.map((finding) => h("p", {}, h("code", {}, finding.run), ": ",
            prose(finding.what))));
    });
    const runs = result.quality.map((own) => item(own.warnings.length ? "bad" : "good",
        `${own.run}: ${digits(own.duration_s)} s at ${digits(own.rate_hz)} Hz`, own.warnings.map((one) => h("p", {}, prose(one)))));
    const open = result.unanswered.map((own) => item("open", own));
    const play = result.suggestions.map((own) => item("open", `To be played: ${own.what}`, remedy(own.arguments)));
    return [h("h3", {}, "Is something wrong in the logs?"), h("ul", { class: "list" }, questions, runs), h("h3", {}, "What do they leave open?"),
        h("ul", { class: "list" }, open.length ? open : item("good", "Nothing: every parameter is excited"), play)];
}

/** Whether a fit may be had, with its button. */
function offer(result) {
    const out = `${stem(state.model ?? "default.toml").replace(/(-fitted)?$/, "-fitted")}.toml`;
    const fit = async () => {
        const args = [...about("fit"), "--out", fresh(out)];
        const arrive = departure();
        const own = await work(args);
        const made = option(args, "--out");
        if (file(own.result?.out ?? made)) arrive(`\`${made}\` is fitted.`, { model: made, view: "compare" });
    };
    const isHopeless = result.verdict === "nothing_to_learn";
    const words = { nothing_wrong: "Nothing looks wrong, and every parameter is excited: the answer can be had.",
        warnings: "A fit can be had. What is marked above stays uncertain, or bends its result.",
        nothing_to_learn: "No fit: these logs answer nothing. No joint moves, or every run is too short." }[result.verdict];
    return h("section", { class: `card ${isHopeless ? "bad" : "good"}`, "aria-label": "Fit" }, h("h2", {}, "Fit"), h("p", {}, words),
        h("p", { class: "row" }, button("Fit", fit, { id: "fit", class: "main", disabled: isHopeless }),
            state.model ? null : note("It starts from the device's default model.")));
}

export default {
    title: "Check",
    grounds: () => [last("check", same)?.id, last("check", same)?.state],
    async render() {
        if (!state.experiment) return noExperiment();
        const job = await current(about("check"), state.experiment, state.model);
        if (!isOver(job)) return h("section", { class: "card", "aria-busy": "true" }, h("h2", {}, "Check"), waiting("Looking at the logs …"));
        const own = await detail(job.id);
        if (!own.result) return h("section", { class: "card bad", role: "alert" }, h("h2", {}, "Check"),
            h("p", {}, prose(own.error ?? "The check was stopped.")), command(line(about("check"))),
            button("Check again", () => start(about("check"))));
        const { result } = own;
        const known = result.identifiability?.parameters ?? [];
        return [h("section", { class: "card", "aria-label": "Check" }, h("h2", {}, "Check"), h("p", { class: "lead" }, result.what),
            isCurrent(job, ...files("log").map(({ path }) => path)) ? null : note("A log changed since: check again."), list(result),
            h("p", { class: "row" }, button("Check again", () => start(about("check")), { id: "check-again" })), command(own.command)), offer(result),
            known.length ? h("details", { class: "card" }, h("summary", {}, "How well each parameter would be known"),
                table("Errors to be expected of a fit", ["parameter", "value", "±", "open"],
                known.map((one) => [h("code", {}, one.name), number(one.value), number(one.std_error), one.is_open ? "open" : ""]))) : null];
    },
};
