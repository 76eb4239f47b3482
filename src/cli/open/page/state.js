// What is looked at, kept in the address, so that a reload comes back to it.

import { h, toast } from "./dom.js";

export const state = { view: "logs", experiment: null, model: null, run: 0, joint: null };
const watchers = new Set();
const NUMBERS = new Set(["run", "joint"]);

function parse() {
    for (const [key, value] of new URLSearchParams(location.hash.slice(1))) {
        if (key in state) state[key] = NUMBERS.has(key) ? Number(value) : value || null;
    }
}
parse();
addEventListener("hashchange", () => {
    const before = address();
    parse();
    if (address() !== before) watchers.forEach((watcher) => watcher());
});

function address() {
    return `#${new URLSearchParams(Object.entries(state).filter(([, value]) => value !== null && value !== ""))}`;
}

/** Looks at something else. */
export function go(changes) {
    const before = address();
    Object.assign(state, changes);
    if (address() === before) return;
    history[changes.view ? "pushState" : "replaceState"](null, "", address());
    watchers.forEach((watcher) => watcher());
}

/** The beginning of a verb's arguments: the experiment and the model that are chosen. */
export const about = (verb) => [verb, state.experiment, ...(state.model ? ["--model", state.model] : [])];
/** The same for a request; without a model it is the device's own. */
export const asked = () => ({ experiment: state.experiment, model: state.model });

/** What leads to what long work made: at once, or by a button where something else is looked at by then. */
export function departure() {
    const before = { ...state };
    const isHere = () => ["view", "experiment", "model"].every((key) => !before[key] || before[key] === state[key]);
    return (words, changes) => (isHere() ? go(changes)
        : toast(words, "good", h("button", { type: "button", onclick: () => go(changes) }, "Look at it")));
}

export const watch = (watcher) => watchers.add(watcher);
