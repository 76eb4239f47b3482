// Zoom and pan of the pictures on a page. Without it, and in print, they show everything.
"use strict";
// Places of a line: the first as it is written, each further one from the last.
const places = (line) => {
  const numbers = line.match(/-?\d*\.?\d+/g).map(Number);
  let [x, y] = [0, 0];
  return Array.from({ length: numbers.length / 2 }, (_, k) => [(x += numbers[2 * k]), (y += numbers[2 * k + 1])]);
};
for (const picture of document.querySelectorAll("svg.dynid-plot[data-from]")) {
  const whole = [Number(picture.dataset.from), Number(picture.dataset.to)];
  const views = [...picture.querySelectorAll("svg.view")].map((view) => ({
    view,
    width: Number(view.getAttribute("width")),
    height: Number(view.getAttribute("height")),
    left: Number(view.getAttribute("x")),
    top: Number(view.getAttribute("y")),
    low: Number(view.dataset.low),
    high: Number(view.dataset.high),
    margin: Number(view.dataset.margin),
    grid: picture.querySelector(`g.grid-of[data-view="${view.dataset.view}"]`),
    lines: [...view.querySelectorAll("path.curve")].flatMap((path) =>
      path.getAttribute("d").split("M").slice(1).map(places)),
  }));
  const foot = picture.querySelector("g.foot");
  const foot_y = Number(foot.dataset.y);
  let [from, to] = whole;

  const round_step = (rough) => {
    const power = 10 ** Math.floor(Math.log10(rough));
    return [1, 2, 5, 10].map((factor) => factor * power).find((step) => step >= rough) ?? 10 * power;
  };
  const ticks = (low, high, wanted) => {
    const step = round_step((high - low) / wanted);
    const decimals = Math.min(9, Math.max(0, -Math.floor(Math.log10(step))));
    const all = [];
    for (let k = Math.ceil(low / step); k * step <= high; k += 1) {
      all.push([k * step, (k * step).toFixed(decimals).replace("-", "\u2212")]);
    }
    return all;
  };
  // Heights of a line between two places, and at them: where it is straight it has no points of its own.
  const heights = (line, left, right) => {
    const seen = line.filter(([x]) => x >= left && x <= right).map(([, y]) => y);
    for (const place of [left, right]) {
      const next = line.findIndex(([x]) => x > place);
      if (next > 0) {
        const [[x0, y0], [x1, y1]] = [line[next - 1], line[next]];
        seen.push(y0 + ((place - x0) / (x1 - x0)) * (y1 - y0));
      }
    }
    return seen;
  };
  const make = (parent, name, attributes, text) => {
    const element = document.createElementNS(picture.namespaceURI, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (text !== undefined) element.textContent = text;
    parent.append(element);
  };

  const draw = () => {
    const span = whole[1] - whole[0];
    const times = ticks(from, to, 8);
    for (const own of views) {
      const left = ((from - whole[0]) / span) * own.width;
      const width = ((to - from) / span) * own.width;
      let [top, bottom] = [0, own.height];
      if (to - from < 0.999 * span) {
        const seen = own.lines.flatMap((line) => heights(line, left, left + width));
        if (seen.length > 1) {
          const [least, most] = [Math.min(...seen), Math.max(...seen)];
          const extra = own.margin * Math.max(most - least, 1e-3 * own.height);
          [top, bottom] = [least - extra, most + extra];
        }
      }
      own.view.setAttribute("viewBox", `${left} ${top} ${width} ${bottom - top}`);
      const value = (y) => own.high - (y / own.height) * (own.high - own.low);
      const [low, high] = [value(bottom), value(top)];
      own.grid.replaceChildren();
      for (const [tick, label] of ticks(low, high, own.height > 120 ? 6 : 5)) {
        const y = own.top + (own.height * (high - tick)) / (high - low);
        make(own.grid, "path", { class: "grid", d: `M${own.left} ${y}h${own.width}` });
        make(own.grid, "text", { class: "tick", x: own.left - 6, y: y + 4, "text-anchor": "end" }, label);
      }
      for (const [tick] of times) {
        const x = own.left + (own.width * (tick - from)) / (to - from);
        make(own.grid, "path", { class: "grid", d: `M${x} ${own.top}v${own.height}` });
      }
    }
    const { left, width } = views[0];
    foot.replaceChildren();
    for (const [tick, label] of times) {
      const x = left + (width * (tick - from)) / (to - from);
      make(foot, "text", { class: "tick", x, y: foot_y + 15, "text-anchor": "middle" }, label);
    }
  };
  const show = (start, end) => {
    const least = (whole[1] - whole[0]) / 500;
    const length = Math.min(Math.max(end - start, least), whole[1] - whole[0]);
    const middle = (start + end) / 2;
    from = Math.min(Math.max(middle - length / 2, whole[0]), whole[1] - length);
    to = from + length;
    draw();
  };
  const zoom = (factor, about) => show(about - (about - from) * factor, about + (to - about) * factor);
  const pan = (share) => show(from + share * (to - from), to + share * (to - from));
  const actions = {
    "\u2212": ["see more time", () => zoom(2, (from + to) / 2)],
    "+": ["see less time", () => zoom(0.5, (from + to) / 2)],
    "\u2190": ["earlier", () => pan(-0.5)],
    "\u2192": ["later", () => pan(0.5)],
    all: ["the whole run", () => show(...whole)],
  };
  const buttons = document.createElement("div");
  buttons.className = "zoom-buttons";
  for (const [label, [title, act]] of Object.entries(actions)) {
    const button = document.createElement("button");
    Object.assign(button, { type: "button", textContent: label, title });
    button.addEventListener("click", act);
    buttons.append(button);
  }
  picture.before(buttons);

  const time_at = (event) => {
    const box = picture.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * picture.viewBox.baseVal.width;
    return from + ((x - views[0].left) / views[0].width) * (to - from);
  };
  picture.setAttribute("tabindex", "0");
  picture.addEventListener("keydown", (event) => {
    const keys = { "+": "+", "-": "\u2212", ArrowLeft: "\u2190", ArrowRight: "\u2192", 0: "all", Escape: "all" };
    if (keys[event.key]) {
      actions[keys[event.key]][1]();
      event.preventDefault();
    }
  });
  // The wheel scrolls the page until the picture was clicked.
  picture.addEventListener("wheel", (event) => {
    if (document.activeElement === picture) {
      zoom(event.deltaY > 0 ? 1.25 : 0.8, time_at(event));
      event.preventDefault();
    }
  }, { passive: false });
  let grabbed = null;
  picture.addEventListener("pointerdown", (event) => {
    grabbed = time_at(event);
    picture.setPointerCapture(event.pointerId);
  });
  picture.addEventListener("pointermove", (event) => {
    if (grabbed !== null && to - from < whole[1] - whole[0]) {
      const by = grabbed - time_at(event);
      show(from + by, to + by);
    }
  });
  for (const end of ["pointerup", "pointercancel"]) {
    picture.addEventListener(end, () => { grabbed = null; });
  }
  picture.addEventListener("dblclick", () => show(...whole));
}
