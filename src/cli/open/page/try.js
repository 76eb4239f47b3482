// Try: a slider for each parameter, the simulation drawn while it is dragged, and a fit of those that are ticked.

import { act, button, choice, command, digits, h, noExperiment, note, number, prose, put, table } from "./dom.js";
import { Charts } from "./chart.js";
import { basis, detail, file, files, fresh, isOver, jobs, last, name, on, option, post, readFolder, start, stop } from "./server.js";
import { asked, go, state } from "./state.js";
import { readExperiment } from "./logs.js";
import { slider } from "./slider.js";

/** Values and their past, kept while one model is looked at. */
let own = { key: "", parameters: [], values: {}, past: [], future: [], ticked: new Set() };
let refresh = () => {};
const opened = new Map();

async function open() {
    const key = `${state.experiment} ${state.model} ${basis(state.experiment, state.model)}`;
    if (own.key === key) return;
    const { parameters } = await post("api/parameters", asked());
    const values = Object.fromEntries(parameters.map((one) => [one.name, one.value]));
    own = { key, parameters, values, first: { ...values }, settled: { ...values }, past: [], future: [],
        ticked: new Set(parameters.filter((one) => !one.fixed).map((one) => one.name)) };
}

/** What was changed: with what was not, the model is the one that is compared, to the last digit. */
const moved = () => Object.fromEntries(Object.entries(own.values).filter(([key, value]) => value !== own.first[key]));

function settle() {
    if (JSON.stringify(own.settled) === JSON.stringify(own.values)) return;
    own.past.push(own.settled);
    own.future = [];
    own.settled = { ...own.values };
    refresh();
}
function travel(from, to) {
    if (!from.length) return;
    to.push(own.settled);
    own.settled = from.pop();
    own.values = { ...own.settled };
    refresh();
}
const undo = () => travel(own.past, own.future);
const redo = () => travel(own.future, own.past);

const lastFit = () => last("fit", (args) => args[1] === state.experiment);

/** The fit that runs or ran last, drawn iteration by iteration. */
async function fitting(job, cleanup) {
    const place = h("section", { class: "card", "aria-label": "Fit" });
    const costs = [];
    const said = h("p", { class: "lead", role: "status" });
    const charts = new Charts({ label: "Cost", x: { label: "iteration", unit: "" }, range: [0, 1],
        load: () => ({ cost: { t: costs.map((one) => one.iteration), low: costs.map((one) => one.cost), high: costs.map((one) => one.cost) } }) });
    charts.panel({ label: "cost", unit: "", series: [{ name: "cost", label: "cost", color: "--series-1" }] });
    cleanup(() => charts.close());
    const take = (one) => {
        if (one.progress !== "iteration" || one.cost === null) return;
        if (costs.length && costs.at(-1).iteration >= one.iteration && costs.at(-1).cost === one.cost) return;
        costs.push(costs.length && costs.at(-1).iteration >= one.iteration ? { ...one, iteration: costs.at(-1).iteration + 1 } : one);
        charts.whole = [costs[0].iteration - 0.5, costs.at(-1).iteration + 0.5];
        charts.view = [...charts.whole];
        said.textContent = `Iteration ${one.iteration}: cost ${digits(one.cost, 6)}`;
        charts.reload();
    };
    const draw = async () => {
        const now = await detail(job.id);
        (now.progress ?? []).forEach(take);
        const out = option(job.args, "--out");
        // A fit that was over before anyone listened has written what the folder was not asked for since.
        if (now.result?.out && !file(out)) await readFolder();
        put(place, h("h2", {}, `Fit: ${now.state}`), said, charts.element, command(now.command), h("p", { class: "row" },
            isOver(now) ? null : button("Stop and keep what is there", () => stop(job.id), { id: "stop-fit" }),
            now.result?.out && file(out) ? h("button", { type: "button", class: "main", id: "open-fit",
                onclick: () => go({ model: out, view: "compare" }) }, `Compare ${out}`) : null,
            now.state === "stopped" ? button("Go on with it", () => start([...job.args.filter((one) => one !== "--resume"), "--resume"])) : null, now.error ? h("p", { class: "bad-word" }, now.error) : null),
        now.result?.parameters ? table("What the fit moved", ["parameter", "from", "to", "±"],
            now.result.parameters.map((one) => [h("code", {}, one.name), number(one.start), number(one.value, one.unit), number(one.std_error)]))
            : null);
    };
    cleanup(on("progress", (one) => { if (one.job === job.id) take(one); }));
    cleanup(on("job", (one) => { if (one.id === job.id && isOver(one)) act(async () => { await readFolder(); await draw(); }); }));
    await draw();
    return place;
}

async function fit() {
    const names = [...own.ticked];
    if (!names.length) throw new Error("Tick the parameters that the fit may move.");
    const values = moved();
    let { model } = state;
    const base = name(state.model ?? "default").replace(/-tried(-\d+)?$/, "");
    if (Object.keys(values).length) {
        model = (await post("api/tried", { ...asked(), values, out: fresh(`${base}-tried.toml`) })).path;
        await readFolder();
    }
    const all = own.parameters.filter((one) => !one.fixed).every((one) => own.ticked.has(one.name));
    await start(["fit", state.experiment, ...(model ? ["--model", model] : []), ...(all ? [] : ["--only", names.join(",")]), "--out",
        fresh(`${base}-fitted.toml`)]);
}

export default {
    title: "Try",
    grounds: () => [lastFit()?.id, files("checkpoint").map(({ path }) => path)],
    keys(event) {
        if (!(event.ctrlKey || event.metaKey)) return false;
        const key = event.key.toLowerCase();
        if (key === "z") (event.shiftKey ? redo : undo)();
        else if (key === "y") redo();
        else return false;
        return true;
    },
    async render({ cleanup }) {
        if (!state.experiment) return noExperiment();
        const [experiment] = await Promise.all([readExperiment(), open()]);
        const run = experiment.runs.find((one) => one.run === state.run) ?? experiment.runs[0];
        const joint = run.free.includes(state.joint) ? state.joint : run.free[0];
        const of = experiment.device.joints.find((one) => one.number === joint);
        const unit = of?.unit ?? "rad";
        const errors = h("output", { class: "lead", id: "tried-error" }, "\u00a0");
        let measured = { key: "", answer: null };
        const charts = new Charts({ label: `${run.label ?? run.file}, joint ${joint}`, range: [run.t0, run.t1], load: async (from, to, width) => {
            const key = `${from} ${to} ${width}`;
            const body = { ...asked(), run: run.run, values: moved(), from, to, width };
            const [tried, log] = await Promise.all([post("api/try", body), measured.key === key ? measured.answer : post("api/series",
                { of: { experiment: state.experiment, run: run.run }, names: [`q${joint}`], from, to, width })]);
            measured = { key, answer: log };
            errors.replaceChildren(...tried.rmse.flatMap((one) => [`joint ${one.joint}: error `, number(one.rmse),
                one.noise ? ` (${digits(one.rmse / one.noise, 3)} times the noise)  ` : "  "]));
            return Object.fromEntries([...tried.series, ...log.series].map((one) => [one.name, one]));
        } });
        cleanup(() => charts.close());
        charts.panel({ label: "position", unit, tall: true, series: [{ name: `q${joint}`, label: "measured", color: "--measured", thick: true },
            { name: `simulated:${joint}`, label: "simulated", color: "--series-0", dash: [7, 4] }] });
        charts.panel({ label: "residual: measured − simulated", unit, series: [{ name: `residual:${joint}`, label: "residual", color: "--series-1" }] });

        const sliders = new Map();
        const isOpen = (effect, list) => opened.get(effect) ?? (own.parameters.length < 16 || list[0].joint === joint);
        const groups = Map.groupBy(own.parameters, (one) => one.effect);
        const knob = (one) => {
            const tool = slider({ ...one, origin: own.first[one.name], value: own.values[one.name], label: one.name.split(".").slice(-1)[0] },
                (value) => { own.values[one.name] = value; charts.reload(); }, settle);
            sliders.set(one.name, tool);
            return h("li", {}, h("input", { type: "checkbox", id: `fit-${one.name}`, "aria-label": `fit ${one.name}`,
                title: one.fixed ? "The model fixes it" : "a fit may move it", disabled: one.fixed, checked: own.ticked.has(one.name),
                onchange: (event) => { own.ticked[event.target.checked ? "add" : "delete"](one.name); } }), tool.element);
        };
        const tools = h("p", { class: "row" });
        refresh = () => {
            for (const [key, tool] of sliders) tool.set(own.values[key]);
            put(tools, h("button", { type: "button", id: "undo", disabled: !own.past.length, onclick: undo }, "Undo"),
                h("button", { type: "button", id: "redo", disabled: !own.future.length, onclick: redo }, "Redo"),
                h("button", { type: "button", id: "reset", onclick: () => { own.values = { ...own.first }; settle(); } }, "Reset"),
                    button("Fit these", fit, { id: "fit-these", class: "main" }));
            charts.reload();
        };
        const panel = h("section", { class: "card sliders", "aria-label": "Parameters" }, h("h2", {}, "Parameters"), tools,
            [...groups].map(([effect, list]) => h("details", { open: isOpen(effect, list),
                ontoggle: (event) => opened.set(effect, event.target.open) }, h("summary", {}, effect), h("ul", {}, list.map(knob)))));
        refresh();
        const job = lastFit();
        const writes = (checkpoint) => [...jobs.values()].some(({ args }) => checkpoint === `${option(args, "--out")}.checkpoint`);
        const left = files("checkpoint").map(({ path }) => path).filter((path) => !writes(path));
        const pick = (id, label, list, value, key) => choice(id, label, list, value, (chosen) => go({ [key]: Number(chosen) }));
        return h("div", { class: "beside" }, panel, h("div", { class: "stays" },
            h("section", { class: "card", "aria-label": "Picture" }, h("div", { class: "row" },
            pick("try-run", "Run", experiment.runs.map((one) => [one.run, one.label ?? one.file]), run.run, "run"),
            pick("try-joint", "Joint", run.free.map((one) => [one, `joint ${one}`]), joint, "joint"), errors), charts.element),
            job ? await fitting(job, cleanup) : null, left.map((path) => note(prose(`\`${path}\` is what a fit or diagnosis that did not end `
                + `has reached: the same command with \`--out ${path.replace(/\.checkpoint$/, "")} --resume\` goes on from there.`)))));
    },
};
