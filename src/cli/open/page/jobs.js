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

function entry(job) {
    const isLive = !isOver(job);
    const counted = job.last?.progress === "count" ? job.last : null;
    const seconds = h("span", { class: "number", "data-since": isLive && job.state === "running" ? job.began : null },
        job.seconds === null ? "" : `${job.seconds.toFixed(1)} s`);
    return h("li", { class: `job ${job.state}`, id: `job-${job.id}` }, h("span", { class: "state" }, job.state),
        isLive ? h("progress", { "aria-label": `${job.args[0]}: how far`, ...(counted?.of ? { max: counted.of, value: counted.done } : {}) }) : null,
        seconds, h("span", { class: "said" }, isLive ? words(job.last).replaceAll("`", "") : ""), command(job.command),
        job.state === "failed" ? button("Why", async () => toast((await detail(job.id)).error ?? "It said nothing.", "bad"),
            { class: "plain", "aria-label": `Why it failed: ${job.command}` }) : null,
        isLive ? button("Stop", () => stop(job.id), { id: `stop-${job.id}`, "aria-label": `Stop: ${job.command}` }) : null);
}

export function showJobs(place) {
    let isOpen = false;
    const draw = () => {
        const all = [...jobs.values()].filter((job) => job.args[0] !== "devices");
        const live = all.filter((job) => !isOver(job));
        const over = all.filter(isOver).reverse().slice(0, 50);
        put(place, live.length ? h("ul", { class: "live" }, live.map(entry)) : null,
            over.length ? h("details", { open: isOpen, ontoggle: (event) => { isOpen = event.target.open; } },
                h("summary", { id: "jobs-over" }, `Work done: ${over.length}`), h("ul", {}, over.map(entry))) : null);
    };
    let frame = null;
    const soon = () => { frame ??= setTimeout(() => { frame = null; draw(); }, 150); };
    draw();
    const said = new Set([...jobs.values()].filter(isOver).map((job) => job.id));
    on("job", (job) => {
        soon();
        if (isOver(job) && !said.has(job.id)) {
            said.add(job.id);
            if (job.state === "stopped") toast(`Stopped; what was reached is kept: \`${job.command}\``);
        }
    });
    on("progress", (line) => {
        const job = jobs.get(line.job);
        if (job) job.last = line;
        soon();
    });
    on("folder", soon);
    setInterval(() => document.querySelectorAll("[data-since]").forEach((own) =>
        { own.textContent = `${((Date.now() - Number(own.dataset.since)) / 1000).toFixed(1)} s`; }), 500);
}
