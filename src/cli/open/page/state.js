// What is looked at, kept in the address, so that a reload comes back to it.

export const state = { view: "logs", experiment: null, model: null, run: 0, joint: null };
const watchers = new Set();
const NUMBERS = new Set(["run", "joint"]);

function parse() {
    for (const [key, value] of new URLSearchParams(location.hash.slice(1))) {
        if (key in state) state[key] = NUMBERS.has(key) ? Number(value) : value;
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

export const watch = (watcher) => watchers.add(watcher);
