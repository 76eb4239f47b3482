// The window: header, tabs, keys; what is shown follows the address, the files and the jobs.

import { act, choice, dialog, h, lifetime, put, waiting } from "./dom.js";
import { basis, file, files, folder, hear, isOver, on, readFolder } from "./server.js";
import { go, state, watch } from "./state.js";
import { showJobs } from "./jobs.js";
import check from "./check.js";
import compare from "./compare.js";
import diagnose from "./diagnose.js";
import ladder from "./ladder.js";
import logs from "./logs.js";
import tryView from "./try.js";
import wall from "./wall.js";

const VIEWS = { logs, check, compare, try: tryView, diagnose, ladder, wall };
const place = document.getElementById("view");
const tabs = document.getElementById("tabs");
let present = lifetime();
let turn = 0;
let shown = "";
let answered = "";

/** What is asked for. */
const question = () => JSON.stringify([state.view, state.experiment, state.model, state.run, state.joint]);

/** What a view stands on: it is drawn anew when this changes. */
function grounds() {
    const { view, experiment, model } = state;
    return JSON.stringify([question(), basis(experiment, model), VIEWS[view].grounds?.() ?? ""]);
}

async function show(isForced = false) {
    const before = shown;
    shown = grounds();
    if (before === shown && !isForced) return;
    head();
    const own = (turn += 1);
    const view = VIEWS[state.view];
    const asked = question();
    place.setAttribute("aria-labelledby", `tab-${state.view}`);
    document.title = `${view.title} · ${state.experiment ?? "dynid"}`;
    const sign = setTimeout(() => { place.setAttribute("aria-busy", "true"); if (!place.children.length) put(place, waiting("Reading …")); }, 100);
    const life = lifetime();
    let content;
    let isKept = false;
    try {
        content = await view.render({ cleanup: life.add, again: () => (VIEWS[state.view] === view ? show(true) : null) });
    } catch (error) {
        // Without a server what stands there is still the answer; it is drawn anew when there is one again.
        isKept = error.isLost && asked === answered;
        content = h("div", { class: "card bad", role: "alert" }, h("h2", {}, view.title), h("p", {}, error.message),
            h("button", { type: "button", onclick: () => show(true) }, "Try again"));
    }
    clearTimeout(sign);
    if (own !== turn) {
        life.end();
        return;
    }
    place.removeAttribute("aria-busy");
    if (isKept) {
        life.end();
        shown = "to be drawn anew";
        return;
    }
    present.end();
    present = life;
    answered = asked;
    put(place, content);
}

let drawn = "";
/** Draws the head anew where it has changed: a list that is open would be shut. */
function head() {
    const now = JSON.stringify([folder.folder, state.view, state.experiment, state.model, ["experiment", "model"].map((kind) =>
        files(kind).map(({ path }) => path))]);
    if (drawn === now) return;
    drawn = now;
    put(document.getElementById("place"), folder.folder);
    const choose = (key, label) => {
        const known = files(key).map((own) => own.path);
        const none = known.length ? "— choose —" : "— none yet —";
        const own = choice(`choose-${key}`, label, [["", key === "model" ? "the device's default" : none], ...known], state[key] ?? "",
            (value) => go({ [key]: value || null, ...(key === "experiment" ? { run: 0, joint: null } : {}) }));
        return own;
    };
    put(document.getElementById("chosen"), choose("experiment", "Experiment"), choose("model", "Model"));
    put(tabs, Object.entries(VIEWS).map(([key, view], index) => h("button", {
        type: "button", role: "tab", id: `tab-${key}`, "aria-selected": String(key === state.view), "aria-controls": "view",
            "aria-keyshortcuts": String(index + 1),
        tabindex: key === state.view ? 0 : -1, onclick: () => go({ view: key }),
    }, view.title, h("kbd", { "aria-hidden": "true" }, index + 1))));
}

/** Chooses what there is no choice of: the first experiment, the newest model. */
function choose() {
    const changes = {};
    if (!state.experiment || !file(state.experiment)) changes.experiment = (file(folder.experiment)?.path ?? files("experiment")[0]?.path) || null;
    if (state.model && !file(state.model)) changes.model = null;
    const newest = () => [...files("model")].sort((a, b) => b.modified - a.modified)[0]?.path ?? null;
    if (!shown && !state.model) changes.model = file(folder.model)?.path ?? newest();
    if (!(state.view in VIEWS)) changes.view = "logs";
    go(changes);
}

let [isReading, isWished] = [false, false];
/** Reads the folder again: one at a time, and once more where it changed meanwhile. */
async function folderChanged() {
    isWished = true;
    if (isReading) return;
    for (isReading = true; isWished;) {
        isWished = false;
        await act(() => readFolder().then(choose).then(head).then(() => show()));
    }
    isReading = false;
}

function keys(event) {
    const isTyping = event.target.matches("input:not([type=checkbox]):not([type=range]), select, textarea") || document.querySelector("dialog[open]");
    if (event.altKey || isTyping) return;
    const names = Object.keys(VIEWS);
    if (event.ctrlKey || event.metaKey) {
        if (VIEWS[state.view].keys?.(event)) event.preventDefault();
    } else if (event.target.role === "tab" && ["ArrowLeft", "ArrowRight"].includes(event.key)) {
        event.preventDefault();
        go({ view: names[(names.indexOf(state.view) + (event.key === "ArrowLeft" ? -1 : 1) + names.length) % names.length] });
        document.getElementById(`tab-${state.view}`).focus();
    } else if (names[Number(event.key) - 1]) go({ view: names[Number(event.key) - 1] });
    else if (event.key === "?") help();
    else if (!event.target.matches("input, [role=tab]") && !event.target.closest("[role=region], pre, code") && VIEWS[state.view].keys?.(event)) event.preventDefault();
}

function help() {
    const all = [["1 to 7", "the views"], ["← → ↑ ↓", "in Compare: runs and joints"], ["Ctrl+Z, Ctrl+Shift+Z", "in Try: undo, redo"],
        ["drag over a chart", "zoom (in Logs: mark a part)"],
        ["Shift and drag, or Shift and wheel", "move along"], ["Ctrl and wheel, or the wheel after a click", "zoom at the pointer"],
            ["double click", "show all"],
        ["on a chart: ← → + − Home", "move, zoom, show all"], ["on a chart: , and .", "move the cursor and read the values"], ["?", "this list"]];
    dialog("Keys", h("button", { autofocus: true }, "Close"), h("h2", {}, "Keys"),
        h("dl", {}, all.map(([key, what]) => [h("dt", {}, key), h("dd", {}, what)])));
}

act(async () => {
    document.getElementById("keys").addEventListener("click", help);
    document.getElementById("skip").addEventListener("click", (event) => { event.preventDefault(); place.focus(); });
    document.addEventListener("keydown", keys);
    // A file that is dropped beside the zone for logs must not take the page away.
    for (const kind of ["dragover", "drop"]) document.addEventListener(kind, (event) => event.preventDefault());
    on("link", (isThere) => put(document.getElementById("link"), isThere ? ""
        : "No connection to dynid. If it was started anew, open the address that it printed."));
    let timer = null;
    on("job", (job) => { if (isOver(job)) act(() => show()); });
    on("folder", () => { timer ??= setTimeout(() => { timer = null; folderChanged(); }, 500); });
    await readFolder();
    await hear();
    showJobs(document.getElementById("jobs"));
    choose();
    watch(() => show());
    await show(true);
});
