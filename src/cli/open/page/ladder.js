// Ladder: the lineage as a graph, the error falling rung by rung, two rungs beside each other, and the report of a path.

import { act, button, choice, command, h, note, number, prose, put, table, toast } from "./dom.js";
import { current, detail, file, files, folder, fresh, isOver, jobs, name, read, work } from "./server.js";
import { residuals } from "./compare.js";
import { fall, graph, lineage, pathTo } from "./lineage.js";
import { go, state } from "./state.js";
import { readExperiment } from "./logs.js";

let other = null;

/** Lines of two texts: ["same" | "gone" | "new", line], by their longest common subsequence. */
export function diff(before, after) {
    const [a, b] = [before.split("\n"), after.split("\n")];
    const length = Array.from({ length: a.length + 1 }, () => new Uint32Array(b.length + 1));
    for (let i = a.length - 1; i >= 0; i -= 1) for (let j = b.length - 1; j >= 0; j -= 1) length[i][j] = a[i] === b[j] ? length[i + 1][j + 1] + 1
        : Math.max(length[i + 1][j], length[i][j + 1]);
    const lines = [];
    let [i, j] = [0, 0];
    while (i < a.length || j < b.length) {
        if (i < a.length && j < b.length && a[i] === b[j]) lines.push(["same", a[i++]]) && j++;
        else if (j >= b.length || (i < a.length && length[i + 1][j] >= length[i][j + 1])) lines.push(["gone", a[i++]]);
        else lines.push(["new", b[j++]]);
    }
    return lines;
}

/** Only what differs, with two lines about it. */
function brief(lines) {
    const isNear = (index) => lines.slice(Math.max(0, index - 2), index + 3).some(([kind]) => kind !== "same");
    return lines.flatMap((own, index) => (isNear(index) ? [own] : index && isNear(index - 1) ? [["same", "…"]] : []));
}

async function twoRungs(a, b, experiment, cleanup) {
    const [first, second] = await Promise.all([read(a), read(b)]);
    const signs = { same: "  ", gone: "− ", new: "+ " };
    const overlay = h("div", {}, note("Comparing both with the logs …"));
    act(async () => {
        const run = experiment.runs.find((one) => one.role === "validate") ?? experiment.runs[0];
        const charts = await residuals([a, b], run.run, state.joint ?? run.free[0]);
        cleanup(() => charts.close());
        overlay.replaceChildren(charts.element);
    }, overlay);
    return h("section", { class: "card", "aria-label": "Two rungs" }, h("h2", {}, `A: ${a} and B: ${b}`), overlay,
        h("details", { open: true }, h("summary", {}, "What differs between the files"),
            h("pre", { class: "diff", tabindex: 0, role: "region", "aria-label": "Difference" },
            brief(diff(first.text, second.text)).map(([kind, text]) => h("span", { class: kind }, `${signs[kind]}${text}\n`)))),
        h("details", {}, h("summary", {}, `${b} as text`), h("pre", { tabindex: 0, role: "region", "aria-label": b }, second.text)));
}

function rungs(result) {
    const what = (own) => [...own.added.map((one) => `+ ${one}`), ...own.removed.map((one) => `− ${one}`),
        own.changed.length ? `${own.changed.length} values` : ""].filter(Boolean).join(", ") || "—";
    return [h("div", { class: "wide" }, fall(result.rungs, result.noise_floor)),
        [table("Rungs", ["model", "position: fitted", "held out", "torque %: fitted", "held out", "free", "BIC", "Δ", "what changed"],
        result.rungs.map((own) => [own.model, number(own.rmse_fit), number(own.rmse_validate),
        number(own.torque_percent_fit), number(own.torque_percent_validate), number(own.free_parameters), number(own.bic), number(own.delta_bic),
            prose(what(own))])),
    h("p", {}, "Noise of the logs: ", number(result.noise_floor)), result.notes.map((one) => note(prose(one)))]];
}

/** A page of the folder, which knows nothing of this one. */
const link = (path, words = path) => h("a", { href: `${folder.pages}?path=${encodeURIComponent(path)}`, target: "_blank", rel: "noopener" }, words);

async function report(path) {
    const out = fresh(`${name(path.at(-1))}-report.html`);
    const diagnoses = files("diagnosis").sort((a, b) => a.modified - b.modified);
    const own = diagnoses.filter((one) => path.some((model) => one.path.includes(`${name(model)}-diagnosis`))).at(-1) ?? diagnoses.at(-1);
    await work(["report", state.experiment, ...path, ...(own ? ["--diagnosis", own.path] : []), "--out", out]);
    toast(`\`${out}\` is written.`, "good", link(out, "Open it"));
}

export default {
    title: "Ladder",
    grounds: () => [files("model").map(({ path, modified }) => path + modified), files("page").map(({ path }) => path),
        [...jobs.values()].filter(({ args }) => args[0] === "ladder").map(({ id, state: at }) => `${id} ${at}`)],
    async render({ cleanup, again }) {
        const models = await lineage();
        if (!models.length) return note("No model is here yet: fit one.");
        const chosen = state.model ?? models.at(-1).path;
        const path = pathTo(models, chosen);
        if (!file(other) || other === chosen) other = path.at(-2) ?? models.find((one) => one.path !== chosen)?.path ?? null;
        // The graph and the table are of the rungs that lead to what is chosen.
        const args = ["ladder", state.experiment, ...path];
        const job = state.experiment ? await current(args, state.experiment, ...path) : null;
        const errors = new Map();
        const own = job && isOver(job) ? await detail(job.id) : null;
        own?.result?.rungs.forEach((rung, index) => errors.set(path[index], { fit: rung.rmse_fit, validate: rung.rmse_validate }));
        const pick = (model, isOther) => {
            if (isOther) {
                other = model;
                again();
            } else {
                other = chosen;
                go({ model });
            }
        };
        const experiment = state.experiment ? await readExperiment() : null;
        const beside = h("div", {}, choice("choose-other", "Beside it (A; also Shift and click)", models.map((one) => one.path).filter((one) => one !== chosen), other,
            (value) => { other = value; again(); }));
        const two = h("div", {});
        if (other && experiment) act(async () => put(two, await twoRungs(other, chosen, experiment, cleanup)), two);
        const links = files("page").map((page) => link(page.path));
        const [picture, facts] = own?.result ? rungs(own.result) : [note(own?.error ?? "Comparing the rungs on the same runs …"), null];
        return [h("div", { class: "beside" }, h("section", { class: "card", "aria-label": "Lineage" }, h("h2", {}, "Lineage"),
            h("div", { class: "wide", tabindex: 0, role: "region", "aria-label": "Graph" },
                graph(models, { chosen: [other, chosen], path, errors, pick })), models.length > 1 ? beside : null),
        h("section", { class: "card", "aria-label": "Error", "aria-busy": job && !own ? "true" : null }, h("h2", {}, `The way to ${chosen}`), picture,
            h("p", { class: "row" }, button("Export the report of this way", () => report(path),
                { id: "report", class: "main", disabled: !state.experiment }), links))),
        h("section", { class: "card", "aria-label": "Numbers" }, facts, job ? command(job.command) : null), two];
    },
};
