// Wall: a virtual wall under a simulated hand, drawn while its gains, rules and sample rate are moved.

import { button, choice, command, h, line, number, prose, put, toast } from "./dom.js";
import { Charts } from "./chart.js";
import { files, fresh, post, read, readFolder } from "./server.js";
import { slider } from "./slider.js";
import { state } from "./state.js";

const SHIPPED = ["pd", "pd_tuned", "fuzzy_literal", "fuzzy", "fuzzy_tuned", "coupled", "passive", "leaky"];
const own = { wall: "pd", setting: "", speed: "", hand: "", changes: {} };

export default {
    title: "Wall",
    async render({ cleanup, again }) {
        const facts = h("dl", { class: "facts", "aria-live": "polite" });
        const felt = { settled_position: "settled at", peak_to_peak: "swing", chatter_rms: "chatter RMS", frequency: "frequency",
            energy_out: "energy out", stiffness: "stiffness", outside: "time outside" };
        // A model of another device than the setting's cannot meet it: then the setting's own does.
        let model = state.model;
        const said = h("p", { class: "bad-word", role: "status" });
        const body = () => ({ model, setting: own.setting || null, wall: own.wall, changes: own.changes,
            ...(own.hand === "" ? {} : { hand: Number(own.hand) }), ...(own.speed ? { speed: own.speed } : {}) });
        const ask = async () => {
            const answer = await post("api/wall", body()).catch(async (error) => {
                if (!model || error.status !== 422) throw error;
                model = null;
                const without = await post("api/wall", body()).catch(() => { model = state.model; throw error; });
                said.replaceChildren(...prose(`The device's own model meets this wall, not \`${state.model}\`: ${error.message}`));
                return without;
            });
            const { units, depth_max, felt: { measures } } = answer;
            facts.replaceChildren(...Object.entries({ depth_max: "deepest", ...felt }).flatMap(([key, words]) => [h("dt", {}, words),
                h("dd", {}, number(key === "depth_max" ? depth_max : measures[key], units[key]))]));
            return answer;
        };
        // What cannot be played is said beside the choices that it comes from.
        const first = await ask().catch((error) => { said.replaceChildren(...prose(error.message)); return null; });
        let isFirst = true;
        const charts = new Charts({ label: "The hand at the wall", range: first ? [first.t[0], first.t.at(-1)] : [0, 1], load: async () => {
            const now = isFirst ? first : await ask();
            isFirst = false;
            const flat = (low) => ({ t: now.t, low, high: low });
            return { position: flat(now.position), torque: flat(now.torque), wall: flat(now.t.map(() => now.wall)) };
        } });
        cleanup(() => charts.close());
        charts.panel({ label: "position", unit: first?.units.position, tall: true, series: [{ name: "position", label: "handle", color: "--series-0" },
            { name: "wall", label: "wall: it is below this line", color: "--ink", dash: [7, 4] }] });
        charts.panel({ label: "torque of the wall", unit: first?.units.torque, series: [{ name: "torque", label: "torque", color: "--series-1" }] });
        const walls = [...SHIPPED, ...files("wall").map(({ path }) => path)];
        const set = (changes) => { Object.assign(own, changes); again(); };
        const knob = (one) => h("li", {}, slider({ ...one, name: one.key, label: one.key.split(".").at(-1), value: own.changes[one.key] ?? one.value,
            origin: one.value },
            (value) => { own.changes[one.key] = value; charts.reload(); }, () => {}).element);
        const knobs = first?.changes ?? [];
        const rules = [...Map.groupBy(knobs.filter(({ key }) => key.startsWith("rules.")), ({ key }) => key.split(".")[1])];
        const save = async () => {
            const path = fresh("wall.toml");
            await post("api/wall", { ...body(), out: path });
            const rate = own.changes.sample_rate;
            let { setting } = own;
            // The sample rate belongs to the setting: one of its own is written, and the user's stays as it is.
            if (rate && setting) {
                const { text } = await read(setting);
                const file = fresh("setting.toml");
                const { digest } = await post("api/write", { path: file, text, replaces: null });
                // A step of the simulation is no longer than a sample.
                const [sample, step] = [1 / rate, Number(text.match(/^\s*step_s\s*=\s*([\d.eE+-]+)/m)?.[1])];
                await post("api/edit", { path: file, replaces: digest, changes: [{ keys: ["controller", "sample_s"], value: sample },
                    ...(step > sample ? [{ keys: ["simulation", "step_s"], value: sample }] : [])] });
                setting = file;
            } else if (rate) toast("The sample rate belongs to the setting, not to the wall: choose a setting file to have it written.");
            await readFolder();
            const options = [["--setting", setting], ["--model", model], ["--hand", own.hand],
                ["--speed", own.speed]].filter(([, value]) => value !== "" && value !== null);
            put(saved, command(line(["wall", "run", "--wall", path, ...options.flat()])));
        };
        const saved = h("div", {});
        return h("div", { class: "beside" }, h("section", { class: "card sliders", "aria-label": "Wall" }, h("h2", {}, "Wall"),
            h("div", { class: "row" }, choice("wall", "Wall", walls, own.wall, (wall) => set({ wall, changes: {} })),
                choice("wall-setting", "Setting", [["", "the program's own"], ...files("setting").map(({ path }) => path)], own.setting,
                (setting) => set({ setting, changes: {} })),
                choice("wall-speed", "Approach", [["", "the first"], "slow", "medium", "fast"], own.speed, (speed) => set({ speed })),
                    h("label", { class: "field" }, h("span", {}, "Hand"),
                    h("input", { type: "number", class: "short", id: "wall-hand", min: 0, value: own.hand, placeholder: "typical",
                    onchange: (event) => set({ hand: event.target.value }) }))), said,
            h("ul", {}, knobs.filter(({ key }) => !key.startsWith("rules.")).map(knob)),
            rules.length ? [h("h3", {}, "Rules: torque at each set of the position"),
                rules.map(([row, list]) => h("details", {}, h("summary", {}, `speed ${row}`), h("ul", {}, list.map(knob))))] : null,
            h("p", { class: "row" }, h("button", { type: "button", id: "wall-reset", onclick: () => set({ changes: {} }) }, "Reset"),
                button("Write this wall", save, { id: "wall-save", disabled: !first })), saved),
        h("section", { class: "card stays", "aria-label": "Contact" }, h("h2", {}, "Under the hand"), facts, first ? charts.element : null));
    },
};
