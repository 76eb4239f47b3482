// Elements, numbers and short messages. Data reaches the page as text only: nothing here reads HTML.

const PROPERTIES = new Set(["value", "checked", "disabled", "hidden", "open", "multiple", "indeterminate", "selected"]);

function fill(element, properties, children) {
    const late = [];
    for (const [key, value] of Object.entries(properties ?? {})) {
        if (value === null || value === undefined) continue;
        if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
        else if (PROPERTIES.has(key)) late.push([key, value]);
        else if (value !== false || key.startsWith("aria-")) element.setAttribute(key, value === true && !key.startsWith("aria-") ? "" : value);
    }
    element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
    // A select takes its value only once it has its options.
    for (const [key, value] of late) element[key] = value;
    return element;
}

/** An element; children are nodes, text, or lists of them. */
export const h = (tag, properties, ...children) => fill(document.createElement(tag), properties, children);

/** The same for SVG. */
export const svg = (tag, properties, ...children) => fill(document.createElementNS("http://www.w3.org/2000/svg", tag), properties, children);

/** A number to four significant digits, as the program writes it on a terminal. */
export function digits(value, significant = 4) {
    if (value === null || value === undefined || !Number.isFinite(value)) return "—";
    const size = Math.abs(value);
    const text = size !== 0 && (size < 1e-3 || size >= 1e5) ? Number(value).toExponential(significant - 1).replace(/\.?0+e/, "e").replace("e+", "e")
        : String(Number(value.toPrecision(significant)));
    return text.replaceAll("-", "−");
}

/** A number to read, with all of it in its title. */
export function number(value, unit = "") {
    const after = unit && unit !== "1" ? ` ${unit}` : "";
    const full = value === null || value === undefined ? "no value" : `${value}${after}`;
    return h("span", { class: "number", title: full, "data-value": String(value ?? "") },
        digits(value) + (value === null || value === undefined ? "" : after));
}

export const bytes = (count) => (count < 1e3 ? `${count} B` : count < 1e6 ? `${digits(count / 1e3, 3)} kB` : `${digits(count / 1e6, 3)} MB`);

/** Words with `names` in backquotes set as code. */
export const prose = (text) => String(text).split("`").map((part, index) => (index % 2 ? h("code", {}, part) : part));

/** Rows of cells below heads; a cell is text or nodes, a row of the form {cells, ...properties} has properties. */
export function table(caption, heads, rows) {
    const row = (cells, properties) => h("tr", properties, cells.map((cell, index) => h(index === 0 ? "th" : "td",
        index === 0 ? { scope: "row" } : {}, cell)));
    return h("div", { class: "wide", tabindex: 0, role: "region", "aria-label": caption },
        h("table", {}, h("caption", {}, caption), h("thead", {}, h("tr", {}, heads.map((head) => h("th", { scope: "col" }, head)))),
            h("tbody", {}, rows.map((own) => (Array.isArray(own) ? row(own) : row(own.cells, own.properties))))));
}

/** A labelled choice; options are [value, words] or words alone. */
export function choice(id, label, options, value, onchange) {
    const all = options.map((option) => (Array.isArray(option) ? option : [option, option]));
    return h("label", { class: "field" }, h("span", {}, label), h("select", { id, value: value ?? "", onchange: (event) => onchange(event.target.value) },
            all.map(([own, words]) => h("option", { value: own }, words))));
}

/** A button whose work may take a while: busy until it is done, and what goes wrong is said. */
export function button(words, work, properties = {}) {
    const own = h("button", { type: "button", ...properties, onclick: () => act(work, own) }, words);
    return own;
}

/** Does some work and says what goes wrong. */
export async function act(work, element = null) {
    element?.setAttribute("aria-busy", "true");
    try {
        return await work();
    } catch (error) {
        if (!error.isQuiet) toast(error.message, "bad");
        return null;
    } finally {
        element?.removeAttribute("aria-busy");
    }
}

/** Says something at the edge of the page; what went wrong, and what has a button, stays until it is closed. */
export function toast(words, kind = "good", ...more) {
    const place = document.getElementById("toasts");
    const same = [...place.children].find((own) => own.dataset.words === words);
    // What its button does belongs to the newest.
    if (same && !more.length) return same;
    same?.remove();
    const own = h("div", { class: `toast ${kind}`, "data-words": words, role: kind === "bad" ? "alert" : "status" }, h("p", {}, prose(words)), more,
        h("button", { type: "button", class: "plain", "aria-label": "Close this message", onclick: () => own.remove() }, "×"));
    place.append(own);
    if (kind !== "bad" && !more.length) setTimeout(() => own.remove(), 8000);
    return own;
}

/** A command line, with a button that copies it; by an id both keep the focus where they are drawn anew. */
export function command(line, id = null) {
    const copy = async () => {
        await navigator.clipboard.writeText(line);
        toast("Copied.");
    };
    return h("div", { class: "command" }, h("code", { id: id && `${id}-line`, tabindex: 0, role: "group", "aria-label": "Command line" }, line),
        button("Copy", copy, { id: id && `${id}-copy`, class: "plain", "aria-label": `Copy: ${line}` }));
}

/** A word as the program's shell lines quote it. */
const quoted = (word) => (/^[\w@%+=:,./*-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`);
export const line = (args) => ["dynid", ...args].map(quoted).join(" ");

/** Shows a dialog; resolves to the value of the button that closes it. */
export const dialog = (label, buttons, ...content) => new Promise((resolve) => {
    const own = h("dialog", { "aria-label": label, onclose: () => { own.remove(); resolve(own.returnValue); } }, content,
        h("form", { method: "dialog", class: "row" }, buttons));
    document.body.append(own);
    own.showModal();
});

/** Asks in a dialog; true where the answer is yes. */
export const ask = async (question, yes, no = "Cancel") => "yes" === await dialog(question, [h("button", { value: "no", autofocus: true }, no),
    h("button", { value: "yes", class: "main" }, yes)], h("p", {}, prose(question)));

/** Puts new content into a place; the focus stays on what has the same id. */
export function put(place, ...content) {
    const { id, selectionStart, selectionEnd } = place.contains(document.activeElement) ? document.activeElement : { id: "" };
    place.replaceChildren(...content.flat(Infinity).filter((own) => own !== null && own !== undefined && own !== false));
    const own = id ? document.getElementById(id) : null;
    own?.focus({ preventScroll: true });
    if (selectionStart !== null && own?.type?.startsWith("text")) own.setSelectionRange(selectionStart, selectionEnd);
}

/** Ends to be done once; what is added after that is done at once. */
export function lifetime() {
    const ends = [];
    let isOver = false;
    return { add(end) { if (isOver) end(); else ends.push(end); }, end() { isOver = true; ends.splice(0).forEach((end) => end()); } };
}

export const note = (...content) => h("p", { class: "note" }, ...content);
export const noExperiment = () => note("No experiment is chosen. Make one from logs first.");
export const waiting = (words) => h("p", { class: "waiting", role: "status" }, words);
