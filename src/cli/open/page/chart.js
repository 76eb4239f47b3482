// Charts on canvas: panels one below the other that share range, cursor and marked spans.
//
// A column of data is what lies between its `low` and `high`, so that a chart of a million rows hides no peak.

import { digits, h, svg, table } from "./dom.js";

const LEFT = 66;
const RIGHT = 10;
const DASHES = [[], [7, 4], [2, 3], [10, 3, 2, 3], [5, 2], [1, 2]];

/** The colour of the n-th of several series, and a dash that tells it from the others without colour. */
export const look = (n) => ({ color: `--series-${n % 7}`, dash: DASHES[n % DASHES.length] });

/** Round numbers between two ends, about one in every `room` pixels. */
function ticks(from, to, pixels, room) {
    const rough = (to - from) / Math.max(1, pixels / room);
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = power * ([1, 2, 5].find((own) => own * power >= rough) ?? 10);
    if (!(step > 0) || !Number.isFinite(step)) return [];
    const first = Math.ceil(from / step - 1e-9);
    return Array.from({ length: Math.min(50, Math.floor(to / step + 1e-9) - first + 1) }, (_, index) => Number(((first + index) * step).toPrecision(12)));
}

const key = ({ color, dash, thick }) => svg("svg", { class: "key", "aria-hidden": "true" }, svg("line",
    { x2: 26, y1: 4, y2: 4, stroke: `var(${color})`, "stroke-width": thick ? 4 : 2, "stroke-dasharray": (dash ?? []).join(" ") }));

export class Charts {
    /**
     * `label` names the whole, `x` is {label, unit}, `range` its two ends, `load(from, to, width)` gives
     * {series name: {t, low, high}}. With `onselect(from, to)` a drag selects; without, it zooms.
     */
    constructor({ label, x = { label: "time", unit: "s" }, range, load, onselect = null, onrange = null, view = null }) {
        Object.assign(this, { label, x, whole: range, view: [...(view ?? range)], load, onselect, onrange });
        this.panels = [];
        this.spans = [];
        this.data = {};
        this.cursor = null;
        this.readout = h("output", { class: "readout" }, "\u00a0");
        this.values = h("div", { class: "values", hidden: true });
        const tool = (words, title, work) => h("button", { type: "button", class: "plain", title, "aria-label": `${title}: ${label}`, onclick: work }, words);
        this.shown = h("button", { type: "button", class: "plain", "aria-expanded": "false", onclick: () => this.showValues() }, "Values");
        this.bar = h("div", { class: "chart-bar" }, this.readout, h("span", { class: "row" }, tool("+", "Zoom in", () => this.zoomBy(0.5)),
            tool("−", "Zoom out", () => this.zoomBy(2)),
            tool("Whole", "Whole range", () => this.reset()), this.shown));
        this.element = h("section", { class: "charts", "aria-label": label }, this.bar, this.values);
        this.observer = new ResizeObserver(() => { this.reload(); this.draw(); });
        this.observer.observe(this.element);
        this.scheme = matchMedia("(prefers-color-scheme: dark)");
        this.onscheme = () => this.draw();
        this.scheme.addEventListener("change", this.onscheme);
    }

    /** Adds a panel: {label, unit, series: [{name, label, color, dash, kind, thick}], band (half width about 0), tall}. */
    panel(own) {
        const id = `chart-${this.label} ${own.label}`.replace(/\W+/g, "-");
        const canvas = h("canvas", { id, tabindex: 0, role: "img", "aria-keyshortcuts": "ArrowLeft ArrowRight + - Home , .",
            "aria-description": "Arrows move along, plus and minus zoom, Home shows all, comma and full stop read the values.", class: own.tall ? "tall" : "" });
        const legend = h("ul", { class: "legend" }, own.series.map((series) => h("li", {}, key(series), series.label)),
            own.band ? h("li", {}, h("span", { class: "key-band" }), own.bandLabel ?? `noise ±${digits(own.band)} ${own.unit}`) : null);
        const figure = h("figure", {}, h("figcaption", {}, h("strong", {}, own.label), own.unit ? ` [${own.unit}]` : "", legend), canvas);
        this.values.before(figure);
        this.panels.push({ ...own, canvas, figure });
        this.listen(canvas);
        return this;
    }

    listen(canvas) {
        let begin = null;
        const at = (event) => this.toX(event.offsetX);
        canvas.addEventListener("pointerdown", (event) => {
            if (event.button > 1) return;
            begin = { x: event.offsetX, pan: event.shiftKey || event.button === 1, view: [...this.view] };
            canvas.setPointerCapture(event.pointerId);
        });
        canvas.addEventListener("pointermove", (event) => {
            if (begin?.pan) {
                const step = ((event.offsetX - begin.x) / this.width(canvas)) * (begin.view[1] - begin.view[0]);
                this.show(begin.view[0] - step, begin.view[1] - step);
            } else if (begin) this.drag = [this.toX(begin.x), at(event)].sort((a, b) => a - b);
            this.point(at(event));
        });
        canvas.addEventListener("pointerup", (event) => {
            const own = begin;
            [begin, this.drag] = [null, null];
            this.draw();
            if (!own || own.pan || Math.abs(event.offsetX - own.x) < 5) return;
            const ends = [this.toX(own.x), at(event)].sort((a, b) => a - b);
            if (this.onselect) this.onselect(...ends);
            else this.show(...ends);
        });
        canvas.addEventListener("pointercancel", () => { [begin, this.drag] = [null, null]; this.draw(); });
        canvas.addEventListener("pointerleave", () => this.point(null));
        canvas.addEventListener("dblclick", () => this.reset());
        canvas.addEventListener("wheel", (event) => {
            // The wheel scrolls the page, but for a chart that was clicked or with Ctrl.
            if (!event.ctrlKey && document.activeElement !== canvas) return;
            event.preventDefault();
            if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) this.panBy((event.deltaX || event.deltaY) / 600);
            else this.zoomBy(Math.exp(event.deltaY / 400), at(event));
        }, { passive: false });
        canvas.addEventListener("keydown", (event) => {
            const moves = { ArrowLeft: () => this.panBy(-0.2), ArrowRight: () => this.panBy(0.2), "+": () => this.zoomBy(0.5),
                "=": () => this.zoomBy(0.5), "-": () => this.zoomBy(2),
                Home: () => this.reset(), 0: () => this.reset(), ",": () => this.step(-1), ".": () => this.step(1) };
            if (event.ctrlKey || event.metaKey || event.altKey || !moves[event.key]) return;
            event.preventDefault();
            event.stopPropagation();
            moves[event.key]();
        });
    }

    width(canvas) { return Math.max(10, canvas.clientWidth - LEFT - RIGHT); }
    toX(pixel) { return this.view[0] + ((pixel - LEFT) / this.width(this.panels[0].canvas)) * (this.view[1] - this.view[0]); }

    /** Shows the part between two ends. */
    show(from, to) {
        const least = (this.whole[1] - this.whole[0]) * 1e-7;
        const span = Math.min(Math.max(to - from, least), this.whole[1] - this.whole[0]);
        const start = Math.min(Math.max(from, this.whole[0]), this.whole[1] - span);
        this.view = [start, start + span];
        this.onrange?.(this.view);
        this.draw();
        this.reload();
    }
    reset() { this.show(...this.whole); }
    zoomBy(factor, about = (this.view[0] + this.view[1]) / 2) { this.show(about - (about - this.view[0]) * factor, about + (this.view[1] - about) * factor); }
    panBy(share) {
        const step = share * (this.view[1] - this.view[0]);
        this.show(this.view[0] + step, this.view[1] + step);
    }
    step(direction) {
        this.readout.setAttribute("aria-live", "polite");
        const place = this.cursor ?? (this.view[0] + this.view[1]) / 2;
        this.point(Math.min(Math.max(place + (direction * (this.view[1] - this.view[0])) / 100, this.view[0]), this.view[1]));
    }

    /** Puts the cursor; `null` takes it away. */
    point(x) {
        this.cursor = x;
        this.draw();
    }

    /** Gets the data of what is shown: one request at a time, and the newest wish wins. */
    async reload() {
        if (this.loading) {
            this.again = true;
            return;
        }
        this.loading = true;
        do {
            this.again = false;
            const width = this.panels.length ? Math.round(this.width(this.panels[0].canvas)) : 0;
            if (width < 20 || this.isClosed) break;
            this.busy = setTimeout(() => this.element.setAttribute("aria-busy", "true"), 100);
            try {
                const data = await this.load(this.view[0], this.view[1], width);
                if (data) this.data = data;
                this.failure = null;
            } catch (error) {
                this.failure = error.message;
            }
            clearTimeout(this.busy);
            this.element.removeAttribute("aria-busy");
            this.describe();
            this.draw();
        } while (this.again);
        this.loading = false;
    }

    draw() {
        this.frame ??= requestAnimationFrame(() => {
            this.frame = null;
            this.panels.forEach((panel, index) => this.drawPanel(panel, index === this.panels.length - 1));
            this.read();
        });
    }

    /** Indices of the columns of a series that are in view. */
    seen({ t }) {
        const place = (value) => {
            let [low, high] = [0, t.length];
            while (low < high) {
                const middle = (low + high) >> 1;
                if (t[middle] < value) low = middle + 1;
                else high = middle;
            }
            return low;
        };
        return [Math.max(0, place(this.view[0]) - 1), Math.min(t.length, place(this.view[1]) + 1)];
    }

    extent(panel) {
        let [low, high] = panel.band ? [-panel.band, panel.band] : [Infinity, -Infinity];
        if (panel.zero) [low, high] = [Math.min(low, 0), Math.max(high, 0)];
        for (const { name } of panel.series) {
            const own = this.data[name];
            if (!own) continue;
            const [from, to] = this.seen(own);
            for (let i = from; i < to; i += 1) {
                if (own.low[i] !== null && own.low[i] < low) low = own.low[i];
                if (own.high[i] !== null && own.high[i] > high) high = own.high[i];
            }
        }
        if (low > high) return [0, 1];
        const pad = (high - low) * 0.06 || Math.abs(high) * 0.1 || 1;
        return [low - pad, high + pad];
    }

    drawPanel(panel, isLast) {
        const { canvas } = panel;
        const [width, height] = [canvas.clientWidth, canvas.clientHeight];
        const ratio = devicePixelRatio || 1;
        if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
            [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
        }
        const pen = canvas.getContext("2d");
        const style = getComputedStyle(canvas);
        const color = (key) => style.getPropertyValue(key).trim();
        const bottom = height - (isLast ? 36 : 8);
        const [low, high] = this.extent(panel);
        const x = (value) => LEFT + ((value - this.view[0]) / (this.view[1] - this.view[0])) * (width - LEFT - RIGHT);
        const y = (value) => bottom - ((value - low) / (high - low)) * (bottom - 6);
        pen.setTransform(ratio, 0, 0, ratio, 0, 0);
        pen.clearRect(0, 0, width, height);
        pen.font = style.font;
        pen.lineWidth = 1;

        pen.strokeStyle = color("--grid");
        pen.fillStyle = color("--soft");
        pen.textAlign = "right";
        pen.textBaseline = "middle";
        const line = (...points) => {
            pen.beginPath();
            points.forEach(([a, b], index) => (index ? pen.lineTo(a, b) : pen.moveTo(a, b)));
            pen.stroke();
        };
        // Many digits leave the margin: then all ticks of the axis share one power of ten.
        const size = Math.max(Math.abs(low), Math.abs(high));
        const power = size < 1e-2 || size >= 1e4 ? 3 * Math.floor(Math.log10(size) / 3) : 0;
        for (const value of ticks(low, high, bottom, 34)) {
            const at = Math.round(y(value)) + 0.5;
            line([LEFT, at], [width - RIGHT, at]);
            pen.fillText(digits(value / 10 ** power), LEFT - 6, at);
        }
        pen.textAlign = "left";
        if (power) pen.fillText(`× 10${[...String(power)].map((own) => (own === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[own])).join("")}`, 2, 8);
        pen.textAlign = "center";
        for (const value of ticks(this.view[0], this.view[1], width - LEFT, 90)) {
            const at = Math.round(x(value)) + 0.5;
            line([at, 6], [at, bottom]);
            if (isLast) pen.fillText(digits(value, 7), at, bottom + 11);
        }
        if (isLast) pen.fillText(`${this.x.label}${this.x.unit && ` [${this.x.unit}]`}`, LEFT + (width - LEFT - RIGHT) / 2, bottom + 27);

        pen.save();
        pen.beginPath();
        pen.rect(LEFT, 0, width - LEFT - RIGHT, bottom + 1);
        pen.clip();
        const block = (from, to, key) => {
            // What is about all samples is a strip, for colour everywhere marks nothing.
            const isAll = from <= this.whole[0] && to >= this.whole[1];
            pen.fillStyle = color(key);
            pen.fillRect(x(from), 0, Math.max(2, x(to) - x(from)), isAll ? 8 : bottom);
        };
        this.spans.forEach(([from, to, key]) => block(from, to, key ?? "--span"));
        if (this.drag) block(...this.drag, "--select");
        if (panel.band) {
            pen.fillStyle = color("--band");
            pen.fillRect(LEFT, y(panel.band), width, y(-panel.band) - y(panel.band));
        }
        for (const series of panel.series) {
            const own = this.data[series.name];
            if (!own) continue;
            pen.strokeStyle = pen.fillStyle = color(series.color);
            pen.lineWidth = series.thick ? 4 : 1.6;
            pen.lineJoin = "round";
            pen.setLineDash(series.dash ?? []);
            this.trace(pen, own, x, y, series.kind);
            pen.setLineDash([]);
        }
        if (this.cursor !== null) {
            pen.strokeStyle = color("--ink");
            pen.lineWidth = 1;
            line([x(this.cursor), 0], [x(this.cursor), bottom]);
        }
        pen.restore();
        if (this.failure) {
            pen.fillStyle = color("--bad");
            pen.textAlign = "left";
            pen.fillText(this.failure, LEFT + 8, 20, width - LEFT - 16);
        }
    }

    trace(pen, own, x, y, kind) {
        const [from, to] = this.seen(own);
        if (kind === "quartiles") {
            pen.globalAlpha = 0.3;
            pen.beginPath();
            for (let i = from; i < to; i += 1) pen.lineTo(x(own.t[i]), y(own.low[i]));
            for (let i = to - 1; i >= from; i -= 1) pen.lineTo(x(own.t[i]), y(own.high[i]));
            pen.fill();
            pen.globalAlpha = 1;
        }
        let covered = 0;
        for (let i = from; i < to; i += 1) covered += y(own.low[i]) - y(own.high[i]);
        if (kind !== "quartiles" && covered > 8 * (to - from)) {
            // Where columns hide whole oscillations, a line would be dashes upon dashes, and slow: what it covers is one area.
            pen.globalAlpha = 0.75;
            for (let i = from; i < to; i += 1) {
                if (own.low[i] === null) continue;
                const [left, top] = [Math.round(x(own.t[i])), Math.floor(y(Math.max(own.high[i], own.low[i - 1] ?? -Infinity)))];
                const right = i + 1 < own.t.length ? Math.round(x(own.t[i + 1])) : left + 1;
                pen.fillRect(left, top, Math.max(1, right - left), Math.ceil(y(Math.min(own.low[i], own.high[i - 1] ?? Infinity))) - top + 1);
            }
            pen.globalAlpha = 1;
            return;
        }
        pen.beginPath();
        let [isDown, before] = [false, 0];
        for (let i = from; i < to; i += 1) {
            let [first, second] = kind === "quartiles" ? [own.middle[i], own.middle[i]] : [own.low[i], own.high[i]];
            if (first === null || second === null) {
                isDown = false;
                continue;
            }
            if (Math.abs(second - before) < Math.abs(first - before)) [first, second] = [second, first];
            if (isDown) pen.lineTo(x(own.t[i]), y(first));
            else pen.moveTo(x(own.t[i]), y(first));
            if (second !== first) pen.lineTo(x(own.t[i]), y(second));
            [isDown, before] = [true, second];
        }
        pen.stroke();
    }

    /** What all series are at the cursor. */
    read() {
        this.readout.setAttribute("role", this.failure ? "alert" : "status");
        if (this.failure) {
            if (this.readout.textContent !== this.failure) this.readout.textContent = this.failure;
            return;
        }
        if (this.cursor === null) {
            const wish = `${digits(this.view[0], 5)} to ${digits(this.view[1], 5)} ${this.x.unit}`;
            if (this.readout.textContent !== wish) this.readout.textContent = wish;
            return;
        }
        const parts = this.panels.flatMap((panel) => panel.series.map((series) => {
            const own = this.data[series.name];
            if (!own?.t.length) return null;
            let [from, to] = this.seen(own);
            while (from + 1 < to && Math.abs(own.t[from + 1] - this.cursor) <= Math.abs(own.t[from] - this.cursor)) from += 1;
            const [low, high] = [own.low[from], own.high[from]];
            return `${series.label} ${kindly(own.middle ? own.middle[from] : low, own.middle ? own.middle[from] : high)} ${panel.unit}`;
        }));
        this.readout.textContent = [`${this.x.label} ${digits(this.cursor, 5)} ${this.x.unit}`, ...parts.filter(Boolean)].join(" · ");
    }

    /** Says each panel in words, for those who do not see it, and fills the table of values if it is shown. */
    describe() {
        for (const panel of this.panels) {
            const said = panel.series.map((series) => {
                const own = this.data[series.name];
                if (!own?.t.length) return `${series.label}: no values`;
                const least = own.low.reduce((a, b) => (b === null ? a : Math.min(a, b)), Infinity);
                const most = own.high.reduce((a, b) => (b === null ? a : Math.max(a, b)), -Infinity);
                return `${series.label} from ${digits(least)} to ${digits(most)} ${panel.unit}`;
            });
            panel.canvas.setAttribute("aria-label",
                `${this.failure ? `${this.failure} Before that: ` : ""}${panel.label}, ${this.x.label} ${digits(this.view[0])} to ${digits(this.view[1])} ${this.x.unit}: ${said.join("; ")}`);
        }
        if (!this.values.hidden) this.fillValues();
    }

    showValues() {
        this.values.hidden = !this.values.hidden;
        this.shown.setAttribute("aria-expanded", String(!this.values.hidden));
        if (!this.values.hidden) this.fillValues();
    }

    fillValues() {
        const all = this.panels.flatMap((panel) => panel.series.map((series) => ({ ...series, unit: panel.unit,
            own: this.data[series.name] }))).filter(({ own }) => own?.t.length);
        if (!all.length) return;
        const { t } = all[0].own;
        const stride = Math.max(1, Math.ceil(t.length / 100));
        const rows = t.filter((_, index) => index % stride === 0).map((time, index) => [digits(time, 7),
            ...all.map(({ own }) => kindly(own.low[index * stride], own.high[index * stride]))]);
        this.values.replaceChildren(table(`${this.label}: ${stride === 1 ? "every value shown" : `one of each ${stride} values shown`}`,
            [`${this.x.label} [${this.x.unit}]`, ...all.map((own) => `${own.label} [${own.unit}]`)], rows));
    }

    close() {
        this.isClosed = true;
        this.observer.disconnect();
        this.scheme.removeEventListener("change", this.onscheme);
    }
}

const kindly = (low, high) => (low === high ? digits(low) : `${digits(low)} to ${digits(high)}`);

/** The answer of `api/series` by name. */
export const byName = (answer) => Object.fromEntries(answer.series.map((own) => [own.name, own]));
