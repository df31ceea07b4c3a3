"use strict";
(() => {
  const NS = "http://www.w3.org/2000/svg";
  const set = (element, values) => {
    for (const key in values) element.setAttribute(key, values[key]);
    return element;
  };

  const zoomable = (svg) => {
    const data = Object.fromEntries(
      ["begin", "end", "left", "right", "foot"].map((key) => [key, Number(svg.dataset[key])]));
    const moves = svg.querySelector(".moves"), ticks = svg.querySelector(".ticks");
    const labels = svg.querySelectorAll(".mark-label");
    const whole = data.end - data.begin, width = data.right - data.left;
    let from = data.begin, to = data.end;
    const place = (t) => data.left + width * (t - from) / (to - from);
    const step = (span) => {
      const power = 10 ** Math.floor(Math.log10(span));
      return [1, 2, 5, 10].map((f) => f * power).find((s) => s >= span * 0.999999);
    };
    const draw = () => {
      const k = whole / (to - from);
      const shift = data.left - k * data.left - k * width * (from - data.begin) / whole;
      moves.setAttribute("transform", `matrix(${k} 0 0 1 ${shift} 0)`);
      ticks.replaceChildren();
      ticks.append(set(document.createElementNS(NS, "line"),
        { x1: data.left, x2: data.right, y1: data.foot, y2: data.foot, class: "frame" }));
      const each = step((to - from) / 10);
      for (let n = Math.ceil(from / each - 1e-9); n * each <= to + 1e-9 * each; n += 1) {
        const t = n * each, x = place(t);
        ticks.append(set(document.createElementNS(NS, "line"),
          { x1: x, x2: x, y1: data.foot, y2: data.foot + 4, class: "frame" }));
        const text = set(document.createElementNS(NS, "text"),
          { x, y: data.foot + 17, "text-anchor": "middle", class: "tick" });
        text.textContent = String(Number(t.toPrecision(7)));
        ticks.append(text);
      }
      for (const label of labels) {
        const t = Number(label.dataset.t);
        label.setAttribute("x", place(t) + Number(label.dataset.aside));
        label.setAttribute("visibility", t < from || t > to ? "hidden" : "visible");
      }
    };
    const show = (a, span) => {
      span = Math.min(Math.max(span, whole / 500), whole);
      from = Math.min(Math.max(a, data.begin), data.end - span);
      to = from + span;
      draw();
    };
    const zoom = (factor, about) => {
      const middle = about === undefined ? (from + to) / 2 : about;
      show(middle - (middle - from) * factor, (to - from) * factor);
    };
    const at = (event) => {
      const box = svg.getBoundingClientRect();
      const x = (event.clientX - box.left) / box.width * svg.viewBox.baseVal.width;
      return from + (to - from) * (x - data.left) / width;
    };
    const bar = document.createElement("p");
    bar.className = "zoom-bar";
    set(bar, { role: "group", "aria-label": svg.querySelector("title").textContent });
    const marked = labels.length ? Number(labels[0].dataset.t) : undefined;
    const actions = [
      ["nearer", () => zoom(0.5, marked !== undefined && marked >= from && marked <= to ? marked : undefined)],
      ["farther", () => zoom(2)],
      ["earlier", () => show(from - (to - from) / 4, to - from)],
      ["later", () => show(from + (to - from) / 4, to - from)],
      ["all", () => show(data.begin, whole)],
    ];
    for (const [name, act] of actions) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = name;
      button.addEventListener("click", act);
      bar.append(button);
    }
    svg.after(bar);
    svg.addEventListener("dblclick", (event) => zoom(0.5, at(event)));
    svg.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.shiftKey) return;
      event.preventDefault();
      zoom((event.deltaY || event.deltaX) > 0 ? 1.25 : 0.8, at(event));
    }, { passive: false });
    let held = null;
    svg.addEventListener("pointerdown", (event) => { held = at(event); svg.setPointerCapture(event.pointerId); });
    svg.addEventListener("pointermove", (event) => { if (held !== null) show(from + held - at(event), to - from); });
    svg.addEventListener("pointerup", () => { held = null; });
    svg.addEventListener("pointercancel", () => { held = null; });
    window.addEventListener("beforeprint", () => show(data.begin, whole));
  };

  const turnable = (svg) => {
    const middle = JSON.parse(svg.dataset.middle), scale = Number(svg.dataset.scale);
    let [turned, raised] = JSON.parse(svg.dataset.angles);
    const half = svg.viewBox.baseVal.width / 2;
    const arm = svg.querySelector(".arm"), links = [...arm.children];
    const others = [...svg.querySelectorAll(":scope > [data-at], :scope > [data-ends]")];
    const seen = (p, axes) => axes.map((row) => scale * row.reduce((sum, x, i) => sum + x * (p[i] - middle[i]), 0));
    const draw = () => {
      const a = turned * Math.PI / 180, b = raised * Math.PI / 180;
      const right = [Math.cos(a), Math.sin(a), 0];
      const eye = [Math.cos(b) * Math.sin(a), -Math.cos(b) * Math.cos(a), Math.sin(b)];
      const up = [eye[1] * right[2] - eye[2] * right[1], eye[2] * right[0] - eye[0] * right[2],
        eye[0] * right[1] - eye[1] * right[0]];
      const axes = [right, up, eye];
      const line = (element) => {
        const [p, q] = JSON.parse(element.dataset.ends).map((end) => seen(end, axes));
        const ends = { x1: half + p[0], y1: half - p[1], x2: half + q[0] + 0.02, y2: half - q[1] };
        for (const each of element.tagName === "line" ? [element] : element.querySelectorAll("line")) set(each, ends);
        return p[2] + q[2];
      };
      const depth = new Map(links.map((link) => [link, line(link)]));
      arm.replaceChildren(...[...links].sort((one, other) => depth.get(one) - depth.get(other)));
      for (const element of others) {
        if (element.dataset.ends) { line(element); continue; }
        const p = seen(JSON.parse(element.dataset.at), axes), x = half + p[0], y = half - p[1];
        if (element.tagName === "circle") set(element, { cx: x, cy: y });
        else element.setAttribute("d", `M${x - 12} ${y}h24M${x} ${y - 12}v24`);
      }
    };
    const turn = (dx, dy) => {
      turned -= dx;
      raised = Math.min(90, Math.max(-90, raised + dy));
      draw();
    };
    let held = null;
    svg.addEventListener("pointerdown", (event) => {
      held = [event.clientX, event.clientY];
      svg.setPointerCapture(event.pointerId);
    });
    svg.addEventListener("pointermove", (event) => {
      if (held === null) return;
      turn((event.clientX - held[0]) / 2, (event.clientY - held[1]) / 2);
      held = [event.clientX, event.clientY];
    });
    svg.addEventListener("pointerup", () => { held = null; });
    svg.addEventListener("pointercancel", () => { held = null; });
    svg.addEventListener("keydown", (event) => {
      const steps = { ArrowLeft: [-10, 0], ArrowRight: [10, 0], ArrowUp: [0, -10], ArrowDown: [0, 10] };
      if (!(event.key in steps)) return;
      event.preventDefault();
      turn(...steps[event.key]);
    });
  };

  document.querySelectorAll("svg.zooms").forEach(zoomable);
  document.querySelectorAll("svg.turns").forEach(turnable);
})();
