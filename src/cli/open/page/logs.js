// Logs: from files to an experiment. Columns as they were guessed, quality, and which part is held out.

import { act, ask, bytes, button, choice, command, digits, h, note, number, prose, table, toast } from "./dom.js";
import { Charts, byName, look } from "./chart.js";
import { basis, file, files, folder, fresh, get, jobs, last, detail, post, read, readFolder, start, finished, upload, work } from "./server.js";
import { departure, go, state } from "./state.js";

const ROBOTS = ["urdf", "xml", "mjcf", "toml"];
const endsIn = (endings, name) => endings.some((ending) => name.toLowerCase().endsWith(`.${ending}`));
const isLog = (name) => endsIn(folder.log_endings, name);
const ticked = new Set();
let deviceWish = "";
/** What was typed and not yet written: texts of experiments, and corrections of the columns of one `new`. */
const drafts = new Map();
let corrections = { key: "" };
let devices = null;
let marked = null;

/** Files of what was dropped, those in folders too. */
async function dropped(transfer) {
    const walk = async (entry) => {
        if (entry.isFile) return [Object.assign(await new Promise((resolve, reject) => entry.file(resolve, reject)), { way: entry.fullPath })];
        const reader = entry.createReader();
        const all = [];
        for (;;) {
            const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
            if (!some.length) return (await Promise.all(all.map(walk))).flat();
            all.push(...some);
        }
    };
    const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
    return entries.length ? (await Promise.all(entries.map(walk))).flat() : [...transfer.files];
}

async function take(all, again) {
    const own = all.filter((one) => isLog(one.name) || endsIn(ROBOTS, one.name));
    if (!own.length) throw new Error("None of these is a file that can be taken: give CSV, Parquet, Arrow, MATLAB or MCAP, or the robot as URDF, MJCF or TOML.");
    for (const [index, one] of own.entries()) {
        await act(async () => {
            // Logs of several folders often have one name: then that of the folder stands before it.
            const longer = () => fresh([...(one.webkitRelativePath || one.way || "").split("/").slice(-2, -1), one.name].filter(Boolean).join("-"));
            const isTaken = own.findIndex(({ name }) => name === one.name) < index;
            const { path } = await upload(one, isTaken ? longer() : one.name).catch((error) => {
                if (error.status !== 409) throw error;
                return upload(one, longer());
            });
            if (isLog(path)) ticked.add(path);
            toast(`\`${path}\` is in the folder.`);
        });
    }
    await readFolder();
    again();
}

function zone(again) {
    const picker = (id, properties) => h("input", { type: "file", id, multiple: true, class: "hidden-input", tabindex: -1,
        onchange: (event) => { const all = [...event.target.files]; soon(() => take(all, again)); }, ...properties });
    const [some, whole] = [picker("pick-files", { accept: [...folder.log_endings, ...ROBOTS].map((ending) => `.${ending.split(".").pop()}`).join(), "aria-label": "Choose files" }),
        picker("pick-folder", { webkitdirectory: true, "aria-label": "Choose a folder" })];
    const own = h("div", { class: "zone", id: "zone", role: "group", "aria-label": "Drop logs here" },
        h("p", {}, "Drop logs here: CSV, Parquet, Arrow, MATLAB or MCAP, or a folder of them"),
        h("p", { class: "row" }, h("button", { type: "button", id: "choose-files", onclick: () => some.click() }, "Choose files"),
            h("button", { type: "button", id: "choose-folder", onclick: () => whole.click() }, "Choose a folder")), some, whole);
    const soon = (doing) => act(doing, own);
    own.addEventListener("dragover", () => own.classList.add("over"));
    own.addEventListener("dragleave", () => own.classList.remove("over"));
    own.addEventListener("drop", (event) => {
        own.classList.remove("over");
        const wish = dropped(event.dataTransfer);
        soon(async () => take(await wish, again));
    });
    return own;
}

/** Names for a robot: device files of the folder, descriptions, and what the program carries. */
async function robots() {
    const own = folder.files.filter(({ kind, path }) => kind === "device" || /\.(urdf|mjcf|xml)$/i.test(path)).map(({ path }) => path);
    devices ??= (async () => {
        try {
            const job = last("devices") ?? (await start(["devices"]));
            return (await finished(job.id)).result.devices.map(({ id }) => id);
        } catch {
            return [];
        }
    })();
    return [...own, ...(await devices)];
}

function beginning(again) {
    const known = h("datalist", { id: "devices" });
    // Asked for when it is needed: a program that starts would share the processor with the first picture.
    const offer = () => robots().then((all) => known.replaceChildren(...all.map((own) => h("option", { value: own }))));
    const logs = files("log");
    const chosen = () => logs.map(({ path }) => path).filter((path) => ticked.has(path));
    const begin = async () => {
        const device = deviceWish.trim();
        if (!chosen().length) throw new Error("Tick the logs that the experiment is made of.");
        if (!device) throw new Error("Name the robot: a device file, a URDF or an MJCF, or a device that the program carries.");
        await make(["new", ...chosen(), "--device", device, ...(file("experiment.toml") ? ["--out", fresh("experiment")] : [])]);
    };
    return h("section", { class: "card", "aria-label": "A new experiment" }, h("h2", {}, "Logs of the folder"), zone(again),
        logs.length ? h("ul", { class: "ticks" }, logs.map(({ path, bytes: size }) => h("li", {}, h("label", {},
            h("input", { type: "checkbox", id: `tick-${path}`, checked: ticked.has(path),
                onchange: (event) => { ticked[event.target.checked ? "add" : "delete"](path); } }), " ", path,
                h("span", { class: "soft" }, ` ${bytes(size)}`)))))
            : note("No log is here yet."),
        h("div", { class: "row" }, h("label", { class: "field" }, h("span", {}, "Robot"),
            h("input", { id: "device", list: "devices", value: deviceWish, placeholder: "robot.urdf, freedom6s, …",
            onfocus: offer, oninput: (event) => { deviceWish = event.target.value; } })),
            known,
            button("New experiment from the ticked logs", begin, { id: "new", class: "main" })));
}

async function make(args) {
    const arrive = departure();
    const { result } = await work(args);
    const path = result.written.find((own) => file(own)?.kind === "experiment") ?? files("experiment").at(-1)?.path;
    const model = result.written.find((own) => file(own)?.kind === "model");
    arrive("The experiment is written.", { view: "logs", experiment: path ?? state.experiment, model: model ?? state.model, run: 0, joint: null });
}

/** What the last `new` guessed of this experiment, with a way to correct each guess. */
async function guesses() {
    const all = await Promise.all([...jobs.values()].filter((job) => job.args[0] === "new").map(({ id }) => detail(id)));
    const own = all.filter(({ result }) => result?.written.includes(state.experiment)).at(-1);
    return [all.at(-1)?.error ? failed(all.at(-1)) : null, own ? await columnsOf(own) : null];
}

async function columnsOf(own) {
    const { columns, unused, remarks, findings, written } = own.result;
    // The factors as they stand in the file now, which may have been changed since.
    const factors = (await read(state.experiment)).text.split(/^\[scale\]/m)[1]?.split(/^\s*\[/m)[0] ?? "";
    const factorOf = (column) => factors.match(new RegExp(`^[ \\t]*${column.logical}[ \\t]*=[ \\t]*([^\\s#]+)`, "m"))?.[1] ?? String(column.scale);
    const names = [...new Set([...columns.map(({ name }) => name), ...unused.map((one) => one.name ?? one)])];
    const key = `${own.id} ${state.experiment}`;
    if (corrections.key !== key) corrections = { key, wishes: new Map(), scales: new Map() };
    const { wishes, scales } = corrections;
    const rows = columns.map((column) => [h("code", {}, column.logical),
        choice(`column-${column.logical}`, h("span", { class: "unseen" }, `column of ${column.logical}`), names, wishes.get(column.logical) ?? column.name,
            (value) => wishes.set(column.logical, value)),
        h("input", { class: "short", id: `scale-${column.logical}`, "aria-label": `factor of ${column.logical}`, inputmode: "decimal",
            value: scales.get(column.logical) ?? factorOf(column), oninput: (event) => scales.set(column.logical, event.target.value) }),
        [column.what, ...column.factors.map(({ what, factor }) => `${digits(factor)}: ${what}`),
            ...(column.turn ? [`encoder turns at ${digits(column.turn)}`] : [])].join("; ")]);
    const apply = async () => {
        if ([...scales.values()].some((value) => !Number.isFinite(Number(value)) || Number(value) === 0)) throw new Error("A factor is a number that is not 0.");
        if (wishes.size) {
            if (!(await ask(`Write \`${written.join("`, `")}\` anew with these columns? What was changed in them by hand is lost.`, "Write anew"))) return;
            const before = own.args.filter((one, index) => one !== "--force" && !(one === "--column" && wishes.has(own.args[index + 1].split("=")[0]))
                && !(own.args[index - 1] === "--column" && wishes.has(one.split("=")[0])));
            await make([...before, ...[...wishes].flatMap(([ours, theirs]) => ["--column", `${ours}=${theirs}`]), "--force"]);
        }
        if (scales.size) {
            const { digest } = await read(state.experiment);
            await post("api/edit", { path: state.experiment, replaces: digest,
                changes: [...scales].map(([key, value]) => ({ keys: ["scale", key], value: Number(value) })) });
        }
        if (!wishes.size && !scales.size) toast("Nothing was changed.");
        corrections = { key: "" };
    };
    return h("section", { class: "card", "aria-label": "Columns" }, h("h2", {}, "What the columns were taken for"),
        table("Columns of the logs: choose another where the guess is wrong", ["ours", "column of the log", "times", "why"], rows),
        h("ul", {}, [...remarks, ...findings.map((one) => one.what ?? String(one))].map((one) => h("li", {}, prose(one)))),
        h("p", { class: "row" }, button("Apply the corrections", apply, { id: "apply-columns" })), command(own.command));
}

/** A `new` that asks for something: the answer goes on its command line. */
function failed(own) {
    const names = [...own.error.matchAll(/`([^`]+)`/g)].map((one) => one[1]).filter((one) => !one.startsWith("--"));
    const ours = own.error.match(/--column (\w+)=/)?.[1] ?? "";
    const fields = { ours, theirs: "", free: "" };
    const input = (id, label, list) => h("label", { class: "field" }, h("span", {}, label),
        h("input", { id, list, value: fields[id], oninput: (event) => { fields[id] = event.target.value; } }));
    const again = () => make([...own.args, ...(fields.ours && fields.theirs ? ["--column", `${fields.ours}=${fields.theirs}`] : []),
        ...(fields.free ? ["--free", fields.free] : [])]);
    return h("section", { class: "card bad", "aria-label": "What the logs do not tell" }, h("h2", {}, "What the logs do not tell"),
        h("p", {}, prose(own.error)),
        h("div", { class: "row" }, input("ours", "ours, as tau4"), input("theirs", "column of the log", "theirs-names"),
            h("datalist", { id: "theirs-names" }, names.map((one) => h("option", { value: one }))),
            input("free", "or: free joints, as 0,1"), button("Again", again, { id: "new-again", class: "main" })), command(own.command));
}

const blocksOf = (text) => text.split(/^(?=[ \t]*\[\[\s*run\s*\]\])/m);

/** The [[run]] of the experiment's text with parts of its rows as runs of their own. */
export function cut(text, run, parts) {
    const blocks = blocksOf(text);
    const block = blocks[run + 1];
    if (block === undefined) throw new Error("The runs of this experiment are not written as [[run]]: edit it as text.");
    const set = (own, key, value) => {
        const end = own.slice(2).search(/^[ \t]*\[/m);
        const [top, rest] = end < 0 ? [own, ""] : [own.slice(0, end + 2), own.slice(end + 2)];
        const known = new RegExp(`^([ \\t]*${key}[ \\t]*=)(?!.*\\[[^\\]]*$).*$`, "m");
        // What is written over several lines, or without a line for the file, is not for this.
        if (!known.test(top) && (new RegExp(`^[ \\t]*${key}[ \\t]*=`, "m").test(top) || !/^[ \t]*file[ \t]*=.*\n/m.test(top))) {
            throw new Error("This run is written in a way that the page cannot cut: edit the experiment as text.");
        }
        return (known.test(top) ? top.replace(known, `$1 ${value}`) : top.replace(/^([ \t]*file[ \t]*=.*\n)/m, `$1${key} = ${value}\n`)) + rest;
    };
    const whole = block.endsWith("\n") ? block : `${block}\n`;
    blocks[run + 1] = parts.map(({ rows, role, isLater }) => set(set(isLater ? set(whole, "moving", "true") : whole, "rows", `[${rows.join(", ")}]`),
        "role", `"${role}"`).trimEnd()).join("\n\n") + (run + 2 < blocks.length ? "\n\n" : "\n");
    return blocks.join("");
}

async function write(text, digest, words) {
    const before = await read(state.experiment);
    const { path } = before;
    const after = await post("api/write", { path, text, replaces: digest });
    const undo = button("Undo", async () => { await post("api/write", { path, text: before.text, replaces: after.digest }); undo.parentElement.remove(); });
    toast(words, "good", undo);
}

async function holdOut(experiment, run, from, to, role) {
    const { text, digest } = await read(state.experiment);
    const [first, end] = run.rows ?? [0, run.samples];
    let [a, b] = (await post("api/rows", { experiment: state.experiment, run: run.run, from, to })).rows;
    // A rest of a few rows is no run.
    [a, b] = [a - first < 20 ? first : a, end - b < 20 ? end : b];
    if (b - a < 20) throw new Error("Mark at least 20 rows.");
    const parts = [{ rows: [first, a], role: run.role }, { rows: [a, b], role, isLater: a > first },
        { rows: [b, end], role: run.role, isLater: true }].filter(({ rows }) => rows[1] > rows[0]);
    await write(cut(text, run.run, parts), digest, `Rows ${a} to ${b} of \`${run.file}\` are ${role === "validate" ? "held out" : "fitted"} now.`);
    marked = null;
}

async function setRole(run, role) {
    const { digest } = await read(state.experiment);
    await post("api/edit", { path: state.experiment, replaces: digest, changes: [{ keys: ["run", run.run, "role"], value: role }] });
}

function runs(experiment) {
    const rows = experiment.runs.map((run) => ({
        properties: { class: run.run === state.run ? "chosen" : "" },
        cells: [h("button", { type: "button", id: `run-${run.run}`, class: "plain", "aria-pressed": String(run.run === state.run),
            onclick: () => { marked = null; go({ run: run.run }); } }, run.label ?? run.file),
            choice(`role-${run.run}`, h("span", { class: "unseen" }, `role of ${run.label}`), [["fit", "fitted"], ["validate", "held out"]], run.role,
                (value) => act(() => setRole(run, value))),
            run.free.join(", "), number(run.samples), number(run.t1 - run.t0, "s"), number(run.rate_hz, "Hz"), run.closed_loop ? "closed loop" : "open loop",
            run.quality.length ? h("ul", { class: "findings" }, run.quality.map((own) => h("li", {}, prose(own)))) : h("span", { class: "good-word" },
                "✓ nothing wrong")],
    }));
    return table(`Runs of ${state.experiment}`, ["run", "role", "free joints", "samples", "length", "rate", "loop", "quality"], rows);
}

function trace(experiment, run, again) {
    const free = new Map(experiment.device.joints.map((joint) => [joint.number, joint]));
    const names = { q: [], tau: [], ref: [] };
    for (const joint of run.free) for (const kind of Object.keys(names)) if (run.columns.includes(`${kind}${joint}`)) names[kind].push(joint);
    const series = (kind) => names[kind].map((joint, index) => ({ name: `${kind}${joint}`, label: `${kind}${joint} ${free.get(joint)?.name ?? ""}`,
        ...look(index) }));
    const form = h("div", { class: "row", role: "group", "aria-label": "Part of the run" });
    const other = run.role === "fit" ? "validate" : "fit";
    const charts = new Charts({
        label: run.label ?? run.file, range: [run.t0, run.t1],
        load: async (from, to, width) => byName(await post("api/series",
            { of: { experiment: state.experiment, run: run.run }, names: [...series("q"), ...series("tau"), ...series("ref")].map(({ name }) => name),
            from, to, width })),
        onselect: (from, to) => mark(Math.max(from, run.t0), Math.min(to, run.t1)),
    });
    const field = (id, index) => h("input", { id, type: "number", step: "any", class: "short", onchange: (event) => {
        const ends = [...(marked ?? [run.t0, run.t1])];
        ends[index] = event.target.value === "" ? [run.t0, run.t1][index] : Number(event.target.value);
        mark(...ends);
    } });
    const fields = [field("part-from", 0), field("part-to", 1)];
    // As they are typed: the first may be beyond the second until that is typed, too.
    const part = () => [...(marked ?? [run.t0, run.t1])].sort((a, b) => a - b);
    const mark = (...ends) => {
        marked = ends;
        charts.spans = [[...part(), "--select"]];
        charts.draw();
        fill();
    };
    const tools = [button(other === "validate" ? "Hold this part out" : "Fit this part", () => holdOut(experiment, run, ...part(), other),
        { id: "hold-out" }), h("button", { type: "button", id: "zoom-part", onclick: () => charts.show(...part()) }, "Zoom to it")];
    form.append(...["from [s]", "to [s]"].map((label, index) => h("label", { class: "field" }, h("span", {}, label), fields[index])), ...tools);
    // The fields stay, for the Tab key is on its way from one to the next.
    const fill = () => {
        fields.forEach((own, index) => { own.value = marked ? marked[index].toFixed(3) : ""; });
        tools.forEach((own) => { own.disabled = !marked; });
    };
    fill();
    if (marked) charts.spans = [[...part(), "--select"]];
    const unit = (joint) => free.get(joint)?.unit ?? "rad";
    charts.panel({ label: "position", unit: unit(run.free[0]), series: [...series("q"), ...series("ref").map((own) => ({ ...own, dash: [2, 3] }))],
        tall: true });
    charts.panel({ label: "torque", unit: free.get(run.free[0])?.command_unit ?? "N*m", series: series("tau") });
    return { charts, element: h("section", { class: "card", "aria-label": "Trace" }, h("h2", {}, run.label ?? run.file),
        note(`This run is ${run.role === "fit" ? "fitted" : "held out"}. Drag over the trace, or give two times, to `,
            other === "validate" ? "hold a part of it out." : "fit a part of it."), form, charts.element) };
}

let isEditing = false;
async function editor(again) {
    const now = await read(state.experiment);
    const { text, digest } = drafts.get(now.path) ?? now;
    const area = h("textarea", { id: "experiment-text", rows: Math.min(30, text.split("\n").length + 1), spellcheck: "false",
        "aria-label": state.experiment, value: text,
        oninput: () => drafts.set(now.path, { digest, text: area.value }) });
    const save = async () => {
        await write(area.value, digest, `\`${now.path}\` is written.`);
        drafts.delete(now.path);
    };
    const drop = () => { drafts.delete(now.path); again(); };
    return h("details", { class: "card", open: isEditing, ontoggle: (event) => { isEditing = event.target.open; } },
        h("summary", {}, `${now.path} as text`), area,
        digest === now.digest ? null : note("The file has changed since you began to type: save is refused until you take it as it is."),
        h("p", { class: "row" }, button("Save", save, { id: "save-experiment" }), drafts.has(now.path) ? button("Take the file as it is", drop) : null));
}

export default {
    title: "Logs",
    grounds: () => [files("log").map(({ path }) => path), stampOfLogs(), last("new")?.id, last("new")?.state],
    async render({ cleanup, again }) {
        const begin = beginning(again);
        if (!state.experiment) return [begin, ...(await guesses()).filter(Boolean), note("No experiment is chosen: drop logs and make one.")];
        const [experiment, own, guessed] = await Promise.all([readExperiment(), editor(again), guesses()]);
        const parts = [begin, ...guessed];
        const run = experiment.runs.find((one) => one.run === state.run) ?? experiment.runs[0];
        const { charts, element } = trace(experiment, run, again);
        cleanup(() => charts.close());
        return h("div", { class: "beside late" }, h("div", {}, h("section", { class: "card", "aria-label": "Runs" },
            h("h2", {}, `${experiment.device.name}: ${experiment.runs.length === 1 ? "one run" : `${experiment.runs.length} runs`}`),
            runs(experiment),
            h("p", { class: "row" }, h("button", { type: "button", class: "main", id: "to-check", onclick: () => go({ view: "check" }) },
                "Check these logs"))), element), h("div", {}, parts.filter(Boolean), own));
    },
};

let kept = { key: "", path: null, logs: null, stamp: "" };
const stamps = (logs, all = files("log")) => all.filter(({ path }) => !logs || logs.has(path)).map(({ modified }) => modified).join(" ");

/** When the logs of the chosen experiment were written; of all the folder, before it is read. */
export const stampOfLogs = () => stamps(kept.path === state.experiment ? kept.logs : null);

/** The experiment that is chosen, read once for each state of its files. */
export async function readExperiment() {
    const path = state.experiment;
    const key = `${path} ${basis(path)}`;
    if (kept.key !== key || kept.stamp !== stamps(kept.logs)) {
        const logs = kept.path === path ? kept.logs : null;
        const [own, before] = [{ key, path, logs, stamp: stamps(logs) }, files("log")];
        own.answer = get(`api/experiment?path=${encodeURIComponent(path)}`).then((answer) => {
            own.logs = new Set(answer.runs.map(({ file: log }) => path.replace(/[^/]*$/, "") + log));
            own.stamp = stamps(own.logs, before);
            return answer;
        });
        own.answer.catch(() => { own.key = ""; });
        kept = own;
    }
    return kept.answer;
}
