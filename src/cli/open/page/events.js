// One connection for the server's events, whatever the number of tabs: a browser opens only six to one address.
// As a shared worker it passes them on to every tab; `listen` does the same in a tab, where there is no such worker.

const KINDS = ["folder", "job", "progress"];

/** Calls `tell(kind, data)` for every event, and with `link` when the connection comes or goes. */
export function listen(tell) {
    const source = new EventSource("api/events");
    source.onopen = () => tell("link", true);
    source.onerror = () => tell("link", false);
    KINDS.forEach((kind) => source.addEventListener(kind, (event) => tell(kind, JSON.parse(event.data))));
    return source;
}

if ("SharedWorkerGlobalScope" in globalThis) {
    const ports = [];
    const source = listen((kind, data) => ports.forEach((port) => port.postMessage([kind, data])));
    globalThis.onconnect = ({ ports: [port] }) => {
        ports.push(port);
        if (source.readyState === EventSource.OPEN) port.postMessage(["link", true]);
    };
}
