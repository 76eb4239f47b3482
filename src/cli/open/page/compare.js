// Compare: measured over simulated, what is left of both errors, the torque by term; panels with one range and one cursor.

import { button, choice, command, digits, h, line, noExperiment, note, number, prose, table } from "./dom.js";
import { Charts, byName, look } from "./chart.js";
import { basis, post } from "./server.js";
import { about as args, go, state } from "./state.js";
import { readExperiment, stampOfLogs } from "./logs.js";

const AGAINST = ["time", "speed", "position", "load", "frequency"];
const kept = new Map();
let [against, kind] = ["speed", "position"];
let view = { key: "", range: null };
const picked = { key: "", numbers: new Set() };

const keyOf = (model) => `${state.experiment} ${model} ${basis(state.experiment, model)}`;

/** The comparison of a model with the chosen experiment, computed once for each state of the files, and when it is asked for. */
export async function compared(model) {
    await readExperiment();
    const key = keyOf(model);
    if (!kept.has(key)) {
        if (kept.size > 8) kept.clear();
        const wish = post("api/compared", { experiment: state.experiment, model });
        kept.set(key, { wish, logs: stampOfLogs() });
        wish.catch(() => kept.delete(key));
    }
    return kept.get(key).wish;
}

/** Whether its logs have grown since: then it is for the user to say when they are compared again. */
const isOld = () => (kept.get(keyOf(state.model))?.logs ?? stampOfLogs()) !== stampOfLogs();

/** An answer about the comparison of a model; one that the server has forgotten is made again. */
async function about(model, path, body) {
    const own = await compared(model);
    return post(path, body(own.key)).catch(async (error) => {
        if (error.status !== 404) throw error;
        if ((await compared(model)) === own) kept.delete(keyOf(model));
        return post(path, body((await compared(model)).key));
    });
}

/** Residuals of several models over each other, for one joint of one run. */
export async function residuals(models, runIndex, joint) {
    const all = await Promise.all(models.map((model) => compared(model)));
    const run = all[0].runs.find((one) => one.run === runIndex) ?? all[0].runs[0];
    const own = run.joints.find((one) => one.joint === joint) ?? run.joints[0];
    const experiment = await readExperiment();
    const { t0, t1 } = experiment.runs.find((one) => one.run === run.run);
    const charts = new Charts({ label: `Residual of ${run.file}, joint ${own.joint}`, range: [t0, t1], load: async (from, to, width) => {
        const answers = await Promise.all(models.map((model) => about(model, "api/series",
            (key) => ({ of: { key, run: run.run }, names: [`residual:${own.joint}`], from, to, width }))));
        return Object.fromEntries(answers.map(({ series }, index) => [`${index}`, series[0]]));
    } });
    charts.panel({ label: `measured − simulated, ${run.file}, joint ${own.joint}`, unit: own.unit, band: own.noise, tall: true,
        series: models.map((model, index) => ({ name: `${index}`, label: model ?? "default", ...look(index) })) });
    return charts;
}

/** Chips of what was found, each of which marks its samples. */
function chips({ key, findings }, charts, run, joint) {
    // Findings of another comparison have other numbers.
    if (picked.key !== key) Object.assign(picked, { key, numbers: new Set() });
    const { numbers: chosen } = picked;
    const marks = () => {
        const shown = findings.filter((own, index) => chosen.has(index) && own.run === run.run);
        charts.spans = shown.flatMap((own) => {
            const color = own.joint === joint ? "--span" : "--span-other";
            return (own.whole ? [charts.whole] : own.spans).map(([from, to]) => [from, to, color]);
        });
        charts.draw();
    };
    const pick = (own, index, chip) => {
        chosen[chosen.has(index) ? "delete" : "add"](index);
        chip.setAttribute("aria-pressed", String(chosen.has(index)));
        if (own.run !== run.run || own.joint !== joint) go({ run: own.run, joint: own.joint });
        else marks();
    };
    const [here, elsewhere] = [[], []];
    findings.forEach((own, index) => {
        const isHere = own.run === run.run && own.joint === joint;
        const chip = h("button", { type: "button", class: "chip", id: `finding-${index}`, "aria-pressed": String(chosen.has(index)),
            onclick: (event) => pick(own, index, event.currentTarget) }, prose(own.sentence));
        const place = isHere ? null : h("span", { class: "soft" }, `run ${own.run + 1}, joint ${own.joint}: `);
        (isHere ? here : elsewhere).push(h("li", {}, place, chip));
    });
    marks();
    return h("section", { class: "where", "aria-label": "Where model and logs part" },
        here.length ? h("ul", { class: "chips" }, here) : note("Nothing differs from chance in this run and joint."),
        elsewhere.length ? h("details", {}, h("summary", {}, `${elsewhere.length} in other runs and joints`), h("ul", { class: "chips" }, elsewhere)) : null);
}

function scatter(run, { joint, series }, cleanup) {
    const place = h("div", {});
    let [charts, turn] = [null, 0];
    const kinds = ["position", ...(series.includes("torque_residual") ? ["torque"] : [])];
    if (!kinds.includes(kind)) kind = "position";
    const fill = async () => {
        const now = (turn += 1);
        place.setAttribute("aria-busy", "true");
        const own = await about(state.model, "api/scatter", (key) => ({ key, run: run.run, joint, against, error: kind })).catch((error) => error);
        if (now !== turn) return;
        charts?.close();
        place.removeAttribute("aria-busy");
        if (own instanceof Error) return place.replaceChildren(note(own.message));
        const isSpectrum = own.low === null;
        const data = { residual: isSpectrum ? { t: own.x, low: own.middle, high: own.middle } : { t: own.x, low: own.low, high: own.high,
            middle: own.middle } };
        charts = new Charts({ label: `Residual against ${against}`, x: { label: own.x_label, unit: own.x_unit },
            range: [Math.min(...own.x), Math.max(...own.x)], load: () => data });
        charts.panel({ label: isSpectrum ? "amplitude of the residual" : "residual: median and quartiles", unit: own.y_unit, tall: true,
            zero: isSpectrum, series: [{ name: "residual", label: isSpectrum ? "amplitude" : "median, quartiles", color: "--series-0",
            kind: isSpectrum ? "line" : "quartiles" }] });
        place.replaceChildren(charts.element, ...(own.note ? [note(own.note)] : []));
    };
    cleanup(() => { turn = -1; charts?.close(); });
    const pick = h("div", { class: "row", role: "radiogroup", "aria-label": "Residual against" }, "Residual against",
        AGAINST.map((own) => h("label", {}, h("input", { type: "radio", name: "against", id: `against-${own}`, value: own, checked: own === against,
            onchange: () => { against = own; fill(); } }), ` ${own}`)));
    fill();
    return h("section", { class: "card", "aria-label": "Residual against" }, choice("residual-of", "Residual of", kinds, kind,
        (own) => { kind = own; fill(); }), pick, place);
}

function numbers(answer, chosen, joint) {
    const rows = answer.runs.flatMap((run) => run.joints.map((own) => ({
        properties: { class: run === chosen && own.joint === joint ? "chosen" : "" },
        cells: [h("button", { type: "button", class: "plain", id: `to-${run.run}-${own.joint}`,
            onclick: () => go({ run: run.run, joint: own.joint }) }, `${run.file}, joint ${own.joint}`), run.role === "fit" ? "fitted" : "held out",
            number(own.rmse, own.unit), number(own.noise, own.unit), own.rmse && own.noise ? h("span",
                { class: own.rmse < 1.5 * own.noise ? "good-word" : "" }, `${digits(own.rmse / own.noise, 3)} ×`) : "—",
                number(own.torque_percent, "%")],
    })));
    return table("Errors of each run and joint", ["run and joint", "role", "position error RMS", "noise of the log", "times the noise",
        "torque error"], rows);
}

let order = { runs: [], joints: [] };

export default {
    title: "Compare",
    grounds: isOld,
    keys(event) {
        const move = { ArrowLeft: ["runs", -1], ArrowRight: ["runs", 1], ArrowUp: ["joints", -1], ArrowDown: ["joints", 1] }[event.key];
        if (!move || event.ctrlKey || !order.runs.length) return false;
        const [list, step] = [order[move[0]], move[1]];
        const own = move[0] === "runs" ? order.run : order.joint;
        const next = list[(list.indexOf(own) + step + list.length) % list.length];
        go(move[0] === "runs" ? { run: next } : { joint: next });
        return true;
    },
    async render({ cleanup, again }) {
        if (!state.experiment) return noExperiment();
        const [answer, experiment] = await Promise.all([compared(state.model), readExperiment()]);
        const run = answer.runs.find((one) => one.run === state.run) ?? answer.runs[0];
        const own = run.joints.find((one) => one.joint === state.joint) ?? run.joints[0];
        const { joint } = own;
        order = { runs: answer.runs.map((one) => one.run), joints: run.joints.map((one) => one.joint), run: run.run, joint };
        const { t0, t1, label } = experiment.runs.find((one) => one.run === run.run);
        const has = (name) => !own.series || own.series.includes(name);
        const names = [...["measured", "simulated", "residual", "torque", "torque_residual"].filter(has),
            ...own.terms.map((term) => `term:${term}`)].map((name) => `${name}:${joint}`);
        const key = `${state.experiment} ${run.run}`;
        if (view.key !== key) view = { key, range: null };
        const charts = new Charts({
            label: `${label ?? run.file}, joint ${joint}`, range: [t0, t1], view: view.range, onrange: (range) => { view.range = range; },
            load: async (from, to, width) => byName(await about(state.model, "api/series", (key) => ({ of: { key, run: run.run }, names, from, to, width }))),
        });
        cleanup(() => charts.close());
        charts.panel({ label: "position", unit: own.unit, tall: true, series: [{ name: `measured:${joint}`, label: "measured", color: "--measured",
            thick: true }, { name: `simulated:${joint}`, label: "simulated", color: "--series-0", dash: [7, 4] }] });
        charts.panel({ label: "residual: measured − simulated", unit: own.unit, band: own.noise,
            series: [{ name: `residual:${joint}`, label: "residual", color: "--series-1" }] });
        charts.panel({ label: "torque by physical term", unit: own.command_unit ?? "N*m", tall: true,
            series: [...(has("torque") ? [{ name: `torque:${joint}`, label: "commanded", color: "--measured", thick: true }] : []),
            ...own.terms.map((term, index) => ({ name: `term:${term}:${joint}`, label: term, ...look(index) })),
                ...(has("torque_residual") ? [{ name: `torque_residual:${joint}`, label: "left", color: "--ink", dash: [1, 2] }] : [])] });
        const said = answer.json?.runs?.find((one, index) => index === answer.runs.indexOf(run))?.joints.find((one) =>
            one.joint === joint)?.means ?? [];
        const grown = isOld() ? h("p", { class: "row" }, note("A log has changed since."), button("Compare again", () => { kept.clear(); return again(); },
            { id: "compare-again" })) : null;
        return h("div", { class: "beside late" }, h("div", {}, h("section", { class: "card", "aria-label": "Panels" },
            h("h2", {}, `${state.model ?? "Default model"} against ${label ?? run.file}, joint ${joint}`),
            h("div", { class: "row" }, choice("choose-run", "Run", answer.runs.map((one) => [one.run,
                `${one.file}${one.role === "fit" ? "" : " (held out)"}`]), run.run, (value) => go({ run: Number(value) })),
                choice("choose-joint", "Joint", run.joints.map((one) => [one.joint, `joint ${one.joint}`]), joint, (value) => go({ joint: Number(value) })),
                h("p", {}, "error ", number(own.rmse, own.unit), ", noise ", number(own.noise, own.unit),
                    run.lost ? h("strong", {}, " · the simulation drifts away from this log: judge by the torque error") : "")),
            grown, chips(answer, charts, run, joint), charts.element), scatter(run, own, cleanup)),
                h("div", {}, h("section", { class: "card", "aria-label": "Numbers" }, h("h2", {}, "Numbers"), numbers(answer, run, joint),
                said.length ? h("ul", {}, said.map((one) => h("li", {}, prose(one)))) : null, command(line(args("compare"))),
            h("p", { class: "row" }, h("button", { type: "button", id: "to-diagnose", class: "main", onclick: () => go({ view: "diagnose" }) },
                "Ask what is missing"), h("button", { type: "button", onclick: () => go({ view: "try" }) }, "Try values by hand")))));
    },
};
