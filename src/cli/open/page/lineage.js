// The models of the folder as a graph: which came from which.

import { digits, svg } from "./dom.js";
import { get, name } from "./server.js";

/** Models with `parent` (a path or null), the oldest first. */
export const lineage = async () => (await get("api/lineage")).models;

/** From the first ancestor down to a model. */
export function pathTo(models, path) {
    const way = [];
    for (let own = models.find((one) => one.path === path); own && !way.includes(own); own = models.find((one) =>
        one.path === own.parent)) way.unshift(own);
    return way.map((one) => one.path);
}

const WIDTH = 214;
const HEIGHT = 62;

/** The graph: generations go down, branches to the right. `errors` has {fit, validate} by path. */
export function graph(models, { chosen, path, errors, pick }) {
    const children = (parent) => models.filter((one) => (models.some((own) => own.path === one.parent) ? one.parent : null) === parent);
    const places = new Map();
    let column = 0;
    const lay = (own, depth) => {
        const below = children(own.path);
        const x = column;
        below.forEach((child, index) => { if (index) column += 1; lay(child, depth + 1); });
        places.set(own.path, [x, depth]);
    };
    children(null).forEach((root, index) => { if (index) column += 1; lay(root, 0); });
    const depth = Math.max(0, ...[...places.values()].map((own) => own[1]));
    const corner = (own) => [own[0] * (WIDTH + 16) + 4, own[1] * (HEIGHT + 26) + 4];
    const edges = models.filter((one) => places.has(one.parent)).map((one) => {
        const [[x, y], [a, b]] = [corner(places.get(one.path)), corner(places.get(one.parent))];
        return svg("path", { class: `edge${path.includes(one.path) && path.includes(one.parent) ? " on-path" : ""}`,
            d: `M${a + WIDTH / 2} ${b + HEIGHT}C${a + WIDTH / 2} ${b + HEIGHT + 18} ${x + WIDTH / 2} ${y - 18} ${x + WIDTH / 2} ${y}` });
    });
    const short = (text) => (text.length > 26 ? `${text.slice(0, 10)}…${text.slice(-14)}` : text);
    const nodes = models.map((one) => {
        const [x, y] = corner(places.get(one.path) ?? [0, 0]);
        const error = errors.get(one.path);
        const said = error ? `held out ${digits(error.validate)}` : "";
        const mark = chosen.indexOf(one.path);
        return svg("g", { class: `rung${path.includes(one.path) ? " on-path" : ""}${mark >= 0 ? " chosen" : ""}`, id: `rung-${one.path}`, tabindex: 0,
            role: "button", "aria-pressed": String(mark >= 0), "aria-label": [short(name(one.path)), (one.how ?? "").replaceAll("_", " "), said,
            "AB"[mark], one.path, one.parent ? `from ${one.parent}` : ""].filter(Boolean).join(" "),
            onclick: (event) => pick(one.path, event.shiftKey), onkeydown: (event) =>
                { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); pick(one.path, event.shiftKey); } } },
        svg("title", {}, one.path), svg("rect", { x, y, width: WIDTH, height: HEIGHT, rx: 6 }),
            svg("text", { x: x + 10, y: y + 20, class: "rung-name" }, short(name(one.path))),
        svg("text", { x: x + 10, y: y + 37 }, (one.how ?? "").replaceAll("_", " ")), svg("text", { x: x + 10, y: y + 53 }, said),
        mark >= 0 ? svg("text", { x: x + WIDTH - 20, y: y + 53, class: "rung-name" }, "AB"[mark]) : null);
    });
    const size = [(column + 1) * (WIDTH + 16) - 8, (depth + 1) * (HEIGHT + 26) - 18];
    return svg("svg", { viewBox: `0 0 ${size[0]} ${size[1]}`, width: size[0], height: size[1], role: "group", "aria-label": "Lineage of the models" },
        edges, nodes);
}

/** Errors of the rungs on a logarithmic scale: circles are fitted runs, squares are held out. */
export function fall(rungs, noise) {
    const [width, height, left] = [Math.max(520, rungs.length * 130 + 80), 240, 64];
    const all = [...rungs.flatMap((own) => [own.rmse_fit, own.rmse_validate]), noise].filter((value) => value > 0);
    if (!all.length) return null;
    const [low, high] = [Math.floor(Math.log10(Math.min(...all))), Math.ceil(Math.log10(Math.max(...all)) + 1e-9)];
    const x = (index) => left + 50 + index * ((width - left - 120) / Math.max(1, rungs.length - 1));
    const y = (value) => 14 + (height - 60) * (1 - (Math.log10(value) - low) / Math.max(1, high - low));
    const decades = Array.from({ length: high - low + 1 }, (_, index) => 10 ** (low + index));
    const line = (key, kind) => {
        const own = rungs.map((rung, index) => [x(index), rung[key], rung.model]).filter(([, value]) => value > 0);
        return [svg("polyline", { class: `fall ${kind}`, points: own.map(([at, value]) => `${at},${y(value)}`).join(" ") }),
            own.map(([at, value, model]) => svg(kind === "held" ? "rect" : "circle",
            { class: `dot ${kind}`, ...(kind === "held" ? { x: at - 5, y: y(value) - 5, width: 10, height: 10 } : { cx: at, cy: y(value), r: 5 }) },
                svg("title", {}, `${model}: ${value}`)))];
    };
    const said = rungs.map((own) => `${own.model}: fitted ${digits(own.rmse_fit)}, held out ${digits(own.rmse_validate)}`).join("; ");
    return svg("svg", { viewBox: `0 0 ${width} ${height}`, width, class: "fall-chart", role: "img",
        "aria-label": `Position error of each rung. ${said}. Noise of the logs: ${digits(noise)}` },
        decades.map((value) => [svg("line", { class: "grid", x1: left, x2: width - 8, y1: y(value), y2: y(value) }),
            svg("text", { x: left - 6, y: y(value) + 4, "text-anchor": "end" }, digits(value))]),
        noise > 0 ? [svg("line", { class: "noise", x1: left, x2: width - 8, y1: y(noise), y2: y(noise) }),
            svg("text", { x: left + 6, y: y(noise) - 5 }, "noise of the logs")] : null,
        line("rmse_fit", "fit"), line("rmse_validate", "held"), rungs.map((own, index) => svg("text",
            { x: x(index), y: height - 22, "text-anchor": "middle" }, own.model.length > 18 ? `${own.model.slice(0, 8)}…${own.model.slice(-9)}`
            : own.model)),
        svg("text", { x: left, y: height - 4 }, "● fitted runs (full line)   ■ held-out runs (dashes); position error RMS"));
}
