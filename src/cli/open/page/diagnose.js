// Diagnose: candidates while they are asked and fitted, what speaks for and against each, and the next rung.

import { act, button, command, digits, h, lifetime, line, noExperiment, note, number, prose, put, table } from "./dom.js";
import { changed, detail, file, fresh, isCurrent, isOver, last, name, on, option, start, stop, unused, work } from "./server.js";
import { residuals } from "./compare.js";
import { about, departure, state } from "./state.js";
import { readExperiment } from "./logs.js";

const same = (own) => own[1] === state.experiment && option(own, "--model") === state.model;
let picked = null;

/** A candidate's place in words, as progress lines and results both can tell it. */
const words = (one) => `\`${one.effect}\` ${(one.from ?? null) === null ? "at" : `from joint ${one.from} to`} joint ${one.joint}`;

/** What the progress lines of a diagnosis have told so far. */
class Race {
    constructor(samples) {
        Object.assign(this, { samples, steps: [], base: null, said: "Beginning …" });
    }

    take(one) {
        const said = { fitting_model: () => "Fitting the model as it is …", asking: () => `Asking ${one.candidates} candidates what they would add …`,
            comparing: () => `Fitting the ${one.candidates} most promising …` };
        if (said[one.progress]) this.said = said[one.progress]();
        if (one.progress === "screened") {
            this.steps.push(new Map(one.candidates.filter(({ gain }) => gain > 0).map(({ candidate, gain }) => [candidate, { gain, cost: null }])));
        }
        if (one.progress !== "searched" || one.cost === null) return;
        if (!this.steps.length) this.base ??= one.cost;
        const step = this.steps[Number(one.search.match(/^step (\d+)/)?.[1]) - 1];
        const known = step?.get(one.candidate);
        if (step && one.candidate) step.set(one.candidate, { gain: known?.gain ?? 0, cost: Math.min(one.cost, known?.cost ?? Infinity) });
    }

    /** Candidates of each step, the best first, with the one-step error that each leaves of what the step before left. */
    bars() {
        let before = this.base ?? 0;
        return this.steps.map((step, index) => {
            const from = before;
            // The mean log likelihood of a sample is minus the logarithm of its error.
            const share = ({ cost, gain }) => Math.min(1, Math.exp((cost === null ? -gain : cost - from) / this.samples));
            const all = [...step].sort(([, a], [, b]) => (a.cost === null) - (b.cost === null) || share(a) - share(b));
            before = Math.min(before, ...all.map(([, { cost }]) => cost ?? Infinity));
            const bar = ([key, own]) => {
                const fill = h("span", { class: own.cost === null ? "bar-fill promised" : "bar-fill" });
                fill.style.setProperty("inline-size", `${100 * share(own)}%`);
                const title = own.cost === null ? `promises ${own.gain} of log likelihood; not fitted`
                    : `minus log likelihood ${own.cost}, without it ${from}`;
                return h("li", {}, h("button", { type: "button", id: `candidate-${index}-${key}`, class: "bar",
                    "aria-pressed": String(picked === key), onclick: () => { picked = key; this.onpick?.(); } },
                    h("span", { class: "bar-name" }, prose(key)), h("span", { class: "bar-track" }, fill),
                        h("span", { class: "number", title }, `${own.cost === null ? "≈ " : ""}${digits(100 * share(own), 3)} %`)));
            };
            return [h("h3", {}, index ? `Effect ${index + 1}, on top of the best before` : "One effect"),
                h("ol", { class: "bars" }, all.slice(0, 20).map(bar))];
        });
    }
}

/** What the model is called with an effect more. */
const withEffect = (one) => `${name(state.model ?? "default").replace(/-fitted$/, "")}-${one.effect}-${one.joint}`;

/** Adds an effect, fits the model with it, and goes there. */
async function add(one) {
    const base = withEffect(one);
    const arrive = departure();
    const { experiment, model } = state;
    const [better, fitted] = [fresh(`${base}.toml`), fresh(`${base}-fitted.toml`)];
    await work(["add", one.effect, "--joint", String(one.joint), ...(one.from === undefined || one.from === null ? [] : ["--from", String(one.from)]),
        "--model", model, "--out", better]);
    await work(["fit", experiment, "--model", better, "--out", fitted]);
    arrive(`\`${fitted}\` is fitted.`, { model: fitted, view: "ladder" });
}

/** The experiment that decides between two effects, as a command that writes what is to be played. */
function decisive(own, device, free) {
    if (own?.kind !== "sine") return null;
    const csv = `decide-${own.joint}.csv`;
    const joints = free.filter((joint) => !own.locked.includes(joint));
    const played = joints.includes(own.joint) ? joints : [own.joint];
    const play = (out) => ["excite", ...(state.model ? ["--model", state.model] : [device]), "--free", played.join(","), "--signal", "cosine", "--amplitude",
        played.map((joint) => (joint === own.joint ? own.amplitude : 0)).join(","),
        "--frequency", String(own.frequency_hz), "--duration", String(own.duration_s), "--as", "torque", "--out", out];
    return h("div", { class: "remedy" }, command(line(play(unused(csv)))), button("Write this file", () => work(play(fresh(csv))), { id: "decide" }));
}

async function chosen(result, experiment, cleanup, better) {
    const one = result?.ranking.find((own) => words(own) === picked) ?? (picked ? null : result?.ranking[0]);
    const key = one ? words(one) : picked;
    if (!key) return null;
    const [, effect, from, joint] = key.match(/`([^`]+)` (?:at joint|from joint (\d+) to joint) (\d+)/);
    const wish = { effect, joint: Number(joint), from: from === undefined ? null : Number(from) };
    const withIt = file(`${withEffect(wish)}-fitted.toml`)?.path ?? (one && one === result.ranking[0] ? file(better)?.path : null);
    const screened = result?.screening.find((own) => words(own) === key);
    const list = (title, all, kind) => (all?.length ? [h("h3", {}, title), h("ul", { class: kind }, all.map((own) => h("li", {}, prose(own))))] : null);
    const free = [...new Set(experiment.runs.flatMap((run) => run.free))];
    const parts = one ? [
        h("dl", { class: "facts" }, h("dt", {}, "held-out error"), h("dd", {}, number(one.rmse_validate_before), " → ",
            number(one.rmse_validate_after)), h("dt", {}, "Δ BIC"), h("dd", {}, number(one.delta_bic)),
            h("dt", {}, "times the noise, with it"), h("dd", {}, number(one.worst_ratio_after))),
        list("Speaks for it", one.evidence_for, "for"), list("Speaks against it", one.evidence_against, "against"),
        list("Cannot be told from", one.confounded_with.map(words)), one.experiment ? [h("h3", {}, "The experiment that decides"),
            h("p", {}, prose(one.experiment)), decisive(one.typed_experiment, experiment.device.id, free)] : null,
        one.parameters.length ? table("Its parameters", ["parameter", "value", "±", "remark"],
            one.parameters.map((own) => [h("code", {}, own.name), number(own.value), number(own.std_error),
            [own.at_bound ? "at its bound" : "", own.identifiable ? "" : "not identifiable"].filter(Boolean).join(", ")])) : null,
    ] : note(result ? "It is not among what explains the logs: another explains them better, or it does not pay for its parameters."
        : "Its evidence is told when the diagnosis is over.");
    const overlay = h("div", {});
    if (withIt) {
        act(async () => {
            const run = experiment.runs.find((own) => own.role === "validate") ?? experiment.runs[0];
            const charts = await residuals([state.model, withIt], run.run, wish.joint);
            cleanup(() => charts.close());
            overlay.replaceChildren(h("h3", {}, "Its residual over the model's"), charts.element);
        }, overlay);
    }
    return h("section", { class: "card", "aria-label": "Candidate" }, h("h2", {}, prose(key)),
        screened ? h("p", {}, "One step promises a change of −2 log L by ", number(screened.position), ".") : null, parts, overlay,
        h("p", { class: "row" }, button("Add it and fit: the next rung", () => add(wish), { id: "add", class: "main", disabled: !state.model }),
            state.model ? null : note("Choose a model to add it to: fit first.")));
}

export default {
    title: "Diagnose",
    grounds() {
        const job = last("diagnose", same);
        return [job?.id, job?.state, job && changed(option(job.args, "--out"))];
    },
    async render({ cleanup }) {
        if (!state.experiment) return noExperiment();
        const experiment = await readExperiment();
        const job = last("diagnose", same);
        const begin = async () => {
            picked = null;
            const stem = name(state.model ?? "default");
            await start([...about("diagnose"), "--save", fresh(`${stem}-diagnosis.json`), "--out", fresh(`${stem}-better.toml`)]);
        };
        const head = (words) => h("p", { class: "row" }, button(words, begin, { id: "diagnose", class: "main" }), command(line(about("diagnose"))));
        if (!job) return h("section", { class: "card" }, h("h2", {}, "Which effect is missing?"),
            h("p", {}, "Every effect of the library is asked at every joint what it would explain; the most promising are fitted."),
            head("Diagnose"));
        const own = await detail(job.id);
        const samples = experiment.runs.filter((run) => run.role === "fit").reduce((sum, run) => sum + run.samples * run.free.length, 0);
        const race = new Race(Math.max(1, samples));
        (own.progress ?? []).forEach((one) => race.take(one));
        const [bars, detailed] = [h("div", { class: "live-bars" }), h("div", {})];
        const result = own.result;
        const said = h("p", { class: "lead", role: "status" }, race.said);
        const draw = () => { said.textContent = race.said; put(bars, race.bars()); };
        let look = lifetime();
        cleanup(() => look.end());
        const pick = async () => {
            look.end();
            const life = look = lifetime();
            const element = await chosen(result, experiment, life.add, option(job.args, "--out"));
            if (life === look) put(detailed, element);
        };
        race.onpick = () => { draw(); act(pick); };
        draw();
        let frame = null;
        cleanup(on("progress", (one) => {
            if (one.job !== job.id) return;
            race.take(one);
            frame ??= requestAnimationFrame(() => { frame = null; draw(); });
        }));
        await pick();
        const isOld = isOver(own) && !isCurrent(job, state.experiment, state.model);
        return h("div", { class: "beside" }, h("section", { class: "card", "aria-label": "Candidates" }, h("h2", {}, "Which effect is missing?"),
            result ? result.sentences.map((one) => h("p", { class: "lead" }, prose(one))) : isOver(own) ? h("p", { class: "bad-word" },
                own.error ?? "The diagnosis was stopped; what was fitted until then is kept.") : said,
            isOld ? note("Experiment or model changed since: diagnose again.") : null,
            note("How much each leaves of the one-step error; ≈ and hollow: as screened, not fitted."), bars,
            result?.screening.length ? h("details", {}, h("summary", {}, `All ${result.screening.length} that promised something`),
                table("Change of −2 log L that one step promises", ["effect", "change"],
                result.screening.map((one) => [prose(words(one)), number(one.position)]))) : null,
            result?.refused.length ? h("details", {}, h("summary", {}, "Refused"),
                h("ul", {}, result.refused.map((one) => h("li", {}, prose(one.what ?? JSON.stringify(one)))))) : null,
            own.state === "stopped" ? h("p", { class: "row" }, button("Go on with it", () => start(job.args), { id: "go-on-diagnose" })) : null,
            isOver(own) ? head("Diagnose again") : [command(own.command),
                button("Stop and keep what is fitted", () => stop(job.id), { id: "stop-diagnose" })]), detailed);
    },
};
