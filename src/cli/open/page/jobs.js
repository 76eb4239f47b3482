// The strip of work: what runs, how far it is, the command line that does the same, and a button that stops it.

import { button, command, digits, h, put, toast } from "./dom.js";
import { detail, isOver, jobs, on, stop } from "./server.js";

/** What a line of progress says. */
function words(line) {
    if (!line) return "";
    const of = { count: () => `${line.done} of ${line.of} ${line.what}`, search: () => `fitting the ${line.error} error`,
        iteration: () => `iteration ${line.iteration}, cost ${digits(line.cost, 6)}`, fitting_model: () => "fitting the model",
            asking: () => `asking ${line.candidates} candidates`,
        comparing: () => `fitting the ${line.candidates} most promising`, searched: () => `${line.candidate}: cost ${digits(line.cost, 6)}`,
            note: () => line.note };
    return of[line.progress]?.() ?? "";
}

const entries = new Map();
/** The line of a job, made once for each of its states: what runs changes in place, so that focus and selection stay. */
function entry(job) {
    let own = entries.get(job.id);
    if (own?.state !== job.state) {
        if (own && job.state === "stopped") toast(`Stopped; what was reached is kept: \`${job.command}\``);
        const isLive = !isOver(job);
        const id = `job-${job.id}`;
        const bar = isLive ? h("progress", { "aria-label": `${job.args[0]}: how far` }) : null;
        const seconds = h("span", { class: "number", "data-since": job.state === "running" ? job.began : null },
            job.seconds === null ? "" : `${job.seconds.toFixed(1)} s`);
        const said = h("span", { class: "said" });
        own = { state: job.state, bar, said, element: h("li", { class: `job ${job.state}`, id }, h("span", { class: "state" }, job.state), bar,
            seconds, said, command(job.command, id),
            job.state === "failed" ? button("Why", async () => toast((await detail(job.id)).error ?? "It said nothing.", "bad"),
                { id: `why-${job.id}`, class: "plain", "aria-label": `Why it failed: ${job.command}` }) : null,
            isLive ? button("Stop", () => stop(job.id), { id: `stop-${job.id}`, "aria-label": `Stop: ${job.command}` }) : null) };
        entries.set(job.id, own);
    }
    if (own.bar) {
        own.said.textContent = words(job.last).replaceAll("`", "");
        if (job.last?.progress === "count" && job.last.of) Object.assign(own.bar, { max: job.last.of, value: job.last.done });
        else own.bar.removeAttribute("value");
    }
    return own.element;
}

export function showJobs(place) {
    const live = h("ul", { class: "live" });
    const [count, done] = [h("summary", { id: "jobs-over" }), h("ul", {})];
    const over = h("details", {}, count, done);
    put(place, live, over);
    const fill = (list, all) => { if (all.length !== list.children.length || all.some((own, index) => own !== list.children[index])) put(list, all); };
    const draw = () => {
        const all = [...jobs.values()].filter((job) => job.args[0] !== "devices");
        const ended = all.filter(isOver).reverse().slice(0, 50);
        fill(live, all.filter((job) => !isOver(job)).map(entry));
        fill(done, ended.map(entry));
        over.hidden = !ended.length;
        place.hidden = !all.length;
        count.textContent = `Work done: ${ended.length}`;
    };
    let frame = null;
    const soon = () => { frame ??= setTimeout(() => { frame = null; draw(); }, 150); };
    draw();
    on("job", soon);
    on("progress", (line) => {
        const job = jobs.get(line.job);
        if (job) job.last = line;
        soon();
    });
    on("folder", soon);
    setInterval(() => document.querySelectorAll("[data-since]").forEach((own) =>
        { own.textContent = `${((Date.now() - Number(own.dataset.since)) / 1000).toFixed(1)} s`; }), 500);
}
