// What the page asks of the server, and what the server tells by itself: files that changed, jobs, their progress.

import { listen } from "./events.js";

const listeners = { folder: new Set(), job: new Set(), progress: new Set(), link: new Set() };

/** Calls back on an event; returns what ends that. */
export function on(kind, callback) {
    listeners[kind].add(callback);
    return () => listeners[kind].delete(callback);
}
const tell = (kind, data) => [...listeners[kind]].forEach((callback) => callback(data));

async function answer(response) {
    const text = await response.text();
    let json = null;
    try {
        json = JSON.parse(text);
    } catch {
        if (response.ok) throw new Error("The server's answer is no JSON.");
    }
    if (response.ok) return json;
    throw Object.assign(new Error(json?.error ?? `The server answered ${response.status}.`), { status: response.status });
}

async function call(path, options) {
    try {
        return await answer(await fetch(path, options));
    } catch (error) {
        if (error instanceof TypeError) {
            throw Object.assign(new Error("`dynid open` does not answer: start it again in this folder."), { isLost: true });
        }
        throw error;
    }
}

export const get = (path) => call(path, {});
export const post = (path, body) => call(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
export const upload = (file, name = file.name) =>
    call(`api/upload?name=${encodeURIComponent(name)}`, { method: "POST", headers: { "Content-Type": "application/octet-stream" }, body: file });
export const read = (path) => get(`api/file?path=${encodeURIComponent(path)}`);

/** The folder as last read. */
export let folder = { folder: "", files: [], log_endings: [] };
export async function readFolder() {
    folder = await get("api/folder");
    return folder;
}
export const files = (kind) => folder.files.filter((file) => file.kind === kind);
export const file = (path) => folder.files.find((own) => own.path === path);
/** State of the files that the answers about an experiment and a model stand on, but for its logs. */
export const basis = (...paths) => changed(...paths, ...["device", "effect"].flatMap((kind) => files(kind).map(({ path }) => path)));
export const changed = (...paths) => paths.map((path) => file(path)?.modified ?? 0).join(" ");

/** A name like this one that no file has, and that no job writes, or can go on to write. */
export function unused(name) {
    const [, stem, ending] = name.match(/^(.*?)(\.[^./]*)?$/);
    const outputs = [...jobs.values()].flatMap(({ args }) => [option(args, "--out"), option(args, "--save")]);
    for (let n = 1; ; n += 1) {
        const own = n === 1 ? name : `${stem}-${n}${ending ?? ""}`;
        if (!file(own) && !file(`${own}.checkpoint`) && !taken.has(own) && !outputs.includes(own)) return own;
    }
}
const taken = new Set();
/** The same, kept for who asks until the job that writes it is known. */
export function fresh(name) {
    const own = unused(name);
    taken.add(own);
    setTimeout(() => taken.delete(own), 5000);
    return own;
}
export const stem = (path) => path.replace(/\.[^./]*$/, "");
export const name = (path) => stem(path.split("/").pop());

/** Job summaries by their number, in the order of their beginning. */
export const jobs = new Map();
const details = new Map();
export const isOver = (job) => ["done", "failed", "stopped"].includes(job.state);

export async function detail(id) {
    if (details.has(id)) return details.get(id);
    const own = await get(`api/jobs/${id}`);
    // What a stopped job prints says only where it can go on.
    if (own.state === "stopped") own.result = null;
    if (isOver(own)) details.set(id, own);
    return own;
}

/** Starts a verb of the program; resolves to its summary. */
export async function start(args) {
    const job = await post("api/jobs", { args });
    if (!jobs.has(job.id)) jobs.set(job.id, job);
    tell("job", jobs.get(job.id));
    return job;
}

/** Waits for the end of a job; throws what it says where it has no result. */
export async function finished(id) {
    if (!isOver(jobs.get(id))) {
        await new Promise((resolve) => {
            const end = on("job", (job) => job.id === id && isOver(job) && (end(), resolve()));
        });
    }
    const own = await detail(id);
    // That a job was stopped is said where it is stopped.
    if (!own.result && own.state !== "done") throw Object.assign(new Error(own.error ?? `${own.command}: no answer`), { isQuiet: own.state === "stopped" });
    return own;
}

export async function work(args) {
    const own = await finished((await start(args)).id);
    await readFolder();
    return own;
}
export const stop = (id) => post(`api/jobs/${id}/stop`, {});

/** The last job of a verb of which `test(args)` holds. */
export const last = (verb, test = () => true) => [...jobs.values()].filter((job) => job.args[0] === verb && test(job.args)).pop();

/** Whether a job began after these files were last changed. */
export const isCurrent = (job, ...paths) => paths.every((path) => !path || (file(path)?.modified ?? 0) <= job.began);

/** Whether a job has these arguments and no others. */
export const alike = (args) => (own) => args.length === own.length && args.every((word, index) => word === own[index]);

const begun = new Map();
/** The last job with these arguments, or a new one where it is older than the files: one for each state of them. */
export async function current(args, ...paths) {
    const key = JSON.stringify([args, changed(...paths)]);
    const known = last(args[0], alike(args));
    if (known && (!isOver(known) || begun.get(key) === known.id || isCurrent(known, ...paths))) return known;
    const job = await start(args);
    begun.set(key, job.id);
    return job;
}

/** What an option was given in a job's arguments. */
export const option = (args, key) => (args.includes(key) ? args[args.indexOf(key) + 1] : null);

/** Listens, for as long as the page is there. */
export async function hear() {
    // What happened before, and while the connection was broken; what was heard of an end is newer.
    const ask = async () => (await get("api/jobs")).filter(({ id }) => !isOver(jobs.get(id) ?? {})).forEach((job) => jobs.set(job.id, job));
    const heard = async (kind, data) => {
        if (kind === "job") jobs.set(data.id, data);
        if (kind === "link" && data) {
            await ask();
            tell("folder", { paths: [] });
        }
        tell(kind, data);
    };
    if (globalThis.SharedWorker) {
        const worker = new SharedWorker("events.js", { type: "module" });
        worker.port.onmessage = ({ data: [kind, data] }) => heard(kind, data);
    } else listen(heard);
    await ask();
}
