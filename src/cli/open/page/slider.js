// A slider for a number within its bounds: logarithmic where they span decades on one side of zero.

import { digits, h, number } from "./dom.js";

const STEPS = 2000;
// Of a value, the most that one step may change it by: what is further off than such steps reach is typed.
const FINEST = 0.01;

/** Ends of a slider: the bounds, as far as fine steps reach from the value. */
function ends({ value, lower, upper }) {
    const [least, most] = [lower ?? -Infinity, upper ?? Infinity];
    const size = Math.abs(value) || Math.max(...[lower, upper].map((bound) => Math.abs(bound ?? 0))) || 1;
    const isLog = least > 0 && most - least > FINEST * STEPS * least;
    const [low, high] = isLog ? [size / (1 + FINEST) ** (STEPS / 2), size * (1 + FINEST) ** (STEPS / 2)]
        : [value - size * FINEST * STEPS / 2, value + size * FINEST * STEPS / 2];
    return { isLog, low: Math.max(low, least), high: Math.min(high, most) };
}

/** `own` is {name, label, value, lower, upper, unit, std_error, origin}; calls `onmove(value)` while it is dragged and `onend()` after. */
export function slider(asked, onmove, onend) {
    // Bounds that leave no travel are none.
    const own = asked.upper === asked.lower ? { ...asked, upper: null } : asked;
    const { isLog, low, high } = ends({ ...own, value: own.origin ?? own.value });
    const place = (value) => Math.round(STEPS * (isLog ? Math.log(Math.max(value, low) / low) / Math.log(high / low) : (value - low) / (high - low)));
    const within = (value) => Math.min(Math.max(value, own.lower ?? value), own.upper ?? value);
    const at = (step) => within(isLog ? low * (high / low) ** (step / STEPS) : low + ((high - low) * step) / STEPS);
    const said = (value) => `${digits(value)} ${own.unit ?? ""}`;
    const range = h("input", { type: "range", id: `slide-${own.name}`, min: 0, max: STEPS, step: 1, value: place(own.value),
        "aria-label": `${own.name}, ${said(low)} to ${said(high)}`, "aria-valuetext": said(own.value), list: `marks-${own.name}` });
    const field = h("input", { type: "text", inputmode: "decimal", class: "short", id: `value-${own.name}`,
        "aria-label": `${own.name} in ${own.unit || "its unit"}`, value: digits(own.value, 6), title: String(own.value) });
    const show = (value) => {
        field.value = digits(value, 6);
        field.title = String(value);
        range.setAttribute("aria-valuetext", said(value));
    };
    range.addEventListener("input", () => { const value = at(Number(range.value)); show(value); onmove(value); });
    range.addEventListener("change", onend);
    field.addEventListener("change", () => {
        const value = Number(field.value.replaceAll("−", "-"));
        if (!field.value.trim() || !Number.isFinite(value)) return show(at(Number(range.value)));
        const kept = within(value);
        range.value = place(kept);
        show(kept);
        onmove(kept);
        onend();
    });
    const bound = (value, end, words) => h("span", { class: "bound", title: value === end ? `${words} of the model` : `${words} of this slider` },
        value === end ? "▏" : "", digits(end, 3));
    const error = own.std_error ? h("span", { class: "soft", title: "standard error of the fit" }, "± ", number(own.std_error)) : null;
    const element = h("div", { class: "slider" }, h("label", { class: "name", for: range.id, title: own.meaning ?? own.name }, own.label ?? own.name),
        field, h("span", { class: "soft" }, own.unit ?? ""), error,
        h("div", { class: "track" }, bound(own.lower, low, "lower bound"), range, bound(own.upper, high, "upper bound"),
            h("datalist", { id: `marks-${own.name}` }, h("option", { value: place(own.origin ?? own.value) }))));
    return { element, set(value) { range.value = place(value); show(value); } };
}
