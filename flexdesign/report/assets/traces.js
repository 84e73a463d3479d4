// Curves to zoom into: panels above each other with one abscissa, drawn by uPlot.
// showTraces(place, data) fills an element; data is what flexdesign.report.traces.Traces.payload returns.
"use strict";

function showTraces(place, data, text) {
  const GAP = 65535, values = (y) => Array.from(new Uint16Array(y.data.bytes), (n) => (n === GAP ? null : y.low + n * y.step));
  const colour = (name) => getComputedStyle(place).getPropertyValue(name);
  const unit = (label) => (label.match(/\[([^\]]*)\]\s*$/) || ["", ""])[1];
  const written = (value, of) => (value == null ? "–" : `${Number(value.toPrecision(5))} ${of}`.trim());
  const key = `linked-${showTraces.count = (showTraces.count || 0) + 1}`;

  const tables = data.panels.map((panel) => {
    // Dashed curves are those that others are compared with: they come last, above them.
    for (const group of panel.groups) group.curves.sort((a, b) => a.dashed - b.dashed);
    const groups = panel.groups.map((group) => [
      Array.from(new Float32Array(group.x.bytes)),
      ...group.curves.map((curve) => values(curve.y)),
    ]);
    return groups.length > 1 ? uPlot.join(groups) : groups[0];
  });
  const whole = [Math.min(...tables.map((t) => t[0][0])), Math.max(...tables.map((t) => t[0][t[0].length - 1]))];
  const least = (whole[1] - whole[0]) * 1e-5;
  let range = data.limits || whole;

  function setRange(low, high) {
    const wide = Math.min(Math.max(high - low, least), whole[1] - whole[0]);
    low = Math.min(Math.max((low + high - wide) / 2, whole[0]), whole[1] - wide);
    range = [low, low + wide];
    for (const plot of plots) plot.setScale("x", { min: range[0], max: range[1] });
  }
  const zoom = (factor, share = 0.5) => {
    const [low, high] = range, at = low + share * (high - low);
    setRange(at - (at - low) * factor, at + (high - at) * factor);
  };
  const move = (share) => setRange(range[0] + share * (range[1] - range[0]), range[1] + share * (range[1] - range[0]));
  const all = () => setRange(...whole);

  place.setAttribute("role", "group");
  place.setAttribute("aria-label", text);
  const bar = place.appendChild(document.createElement("div"));
  bar.className = "tools";
  for (const [sign, name, act] of [
    ["+", "Zoom in", () => zoom(0.5)], ["−", "Zoom out", () => zoom(2)],
    ["←", "Earlier", () => move(-0.25)], ["→", "Later", () => move(0.25)], ["All", "Show all", all],
  ]) {
    const button = bar.appendChild(document.createElement("button"));
    button.type = "button";
    button.textContent = sign;
    button.title = name;
    button.setAttribute("aria-label", name);
    button.addEventListener("click", act);
  }
  const hint = bar.appendChild(document.createElement("span"));
  hint.className = "hint";
  hint.textContent = "Drag to zoom, shift-drag to pan, double-click for all; a click on a name hides its curve.";

  const width = () => Math.max(place.clientWidth, 240);
  const plots = data.panels.map((panel, row) => {
    const last = row === data.panels.length - 1, of = unit(panel.y), curves = panel.groups.flatMap((g) => g.curves);
    const font = "12px system-ui, sans-serif";
    const axis = { font, labelFont: font, stroke: () => colour("--soft"), grid: { stroke: "#8a949e40", width: 1 }, ticks: { stroke: "#8a949e", width: 1, size: 4 } };
    const options = {
      width: width(), height: last ? 232 : 200,
      scales: {
        x: { time: false, min: range[0], max: range[1] },
        y: { range: (_, low, high) => (low === 0 && high === 0 ? [-1, 1] : uPlot.rangeNum(low, high, 0.1, true)) }, // else 0 to 100
      },
      axes: [
        { ...axis, label: last ? data.x : "", labelSize: last ? 22 : 0, size: 30 },
        { ...axis, label: panel.y, labelSize: 22, size: 58 },
      ],
      series: [
        { label: data.x.replace(/\s*\[.*/, ""), value: (_, v) => written(v, unit(data.x)) },
        ...curves.map((curve) => ({
          label: curve.label, stroke: curve.colour, width: curve.dashed ? 1.2 : 1.6, dash: curve.dashed ? [5, 4] : undefined,
          points: { show: false }, value: (_, v) => written(v, of),
        })),
      ],
      cursor: { sync: { key, setSeries: false }, drag: { x: true, y: false, setScale: false } },
      hooks: {
        setSelect: [(plot) => {
          const { left, width: wide } = plot.select;
          if (wide > 4) setRange(plot.posToVal(left, "x"), plot.posToVal(left + wide, "x"));
          plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
        }],
      },
    };
    const box = place.appendChild(document.createElement("div"));
    box.className = "panel";
    box.tabIndex = 0;
    box.setAttribute("role", "group");
    box.setAttribute("aria-label", `${panel.y} over ${data.x}; arrows pan, plus and minus zoom, 0 shows all`);
    const plot = new uPlot(options, tables[row], box);
    listen(box, plot);
    return plot;
  });

  function listen(box, plot) {
    const share = (event) => {
      const seen = plot.over.getBoundingClientRect();
      return Math.min(Math.max((event.clientX - seen.left) / seen.width, 0), 1);
    };
    box.addEventListener("keydown", (event) => {
      const act = {
        ArrowLeft: () => move(-0.1), ArrowRight: () => move(0.1), "+": () => zoom(0.7), "=": () => zoom(0.7),
        "-": () => zoom(1.4), 0: all,
      }[event.key];
      if (act && event.target === box) { event.preventDefault(); act(); }
    });
    plot.over.addEventListener("dblclick", all);
    // The wheel scrolls the page until the panel has the focus.
    plot.over.addEventListener("wheel", (event) => {
      if (!box.contains(document.activeElement)) return;
      event.preventDefault();
      if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) move(event.deltaX / 800);
      else zoom(Math.exp(event.deltaY / 400), share(event));
    }, { passive: false });
    const touches = new Map();
    plot.over.style.touchAction = "pan-y";
    plot.over.addEventListener("mousedown", (event) => { if (event.shiftKey) event.stopImmediatePropagation(); }, true);
    plot.over.addEventListener("pointerdown", (event) => {
      box.focus({ preventScroll: true });
      if (event.pointerType === "mouse" && !event.shiftKey) return;
      plot.over.setPointerCapture(event.pointerId);
      touches.set(event.pointerId, share(event));
    });
    plot.over.addEventListener("pointermove", (event) => {
      if (!touches.has(event.pointerId)) return;
      const before = [...touches.values()];
      touches.set(event.pointerId, share(event));
      const after = [...touches.values()];
      if (after.length === 1) move(before[0] - after[0]);
      else {
        const spread = (ends) => Math.max(Math.abs(ends[0] - ends[1]), 0.02);
        zoom(spread(before) / spread(after), (after[0] + after[1]) / 2);
      }
    });
    for (const end of ["pointerup", "pointercancel"]) plot.over.addEventListener(end, (event) => touches.delete(event.pointerId));
    for (const name of box.querySelectorAll(".u-legend .u-series > th")) {
      name.tabIndex = 0;
      name.setAttribute("role", "button");
      name.addEventListener("keydown", (event) => { if (event.key === "Enter") name.click(); });
    }
  }

  new ResizeObserver(() => {
    for (const plot of plots) if (place.clientWidth && plot.width !== width()) plot.setSize({ width: width(), height: plot.height });
  }).observe(place);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => plots.forEach((plot) => plot.redraw()));
  return { plots, setRange, range: () => range };
}
