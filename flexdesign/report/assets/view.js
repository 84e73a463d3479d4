// A part that turns: drawn by three.js, with a legend, a scale bar and axes of its own.
// showView(place, data, text) fills an element; data is what flexdesign.report.views.View.payload returns.
"use strict";

function showView(place, data, text) {
  // Arrays come column by column; three.js wants them row by row.
  const rows = (Kind, { bytes, columns }) => {
    const given = new Kind(bytes), count = given.length / columns;
    return given.map((_, at) => given[(at % columns) * count + Math.floor(at / columns)]);
  };
  const rounded = (packed) => Float32Array.from(rows(Uint16Array, packed.data), (n) => packed.low + n * packed.step);
  const corners = (packed) => {
    const found = rows(Uint32Array, packed), { columns } = packed;
    for (let at = 0; at < found.length; at++) {
      if (at % columns) found[at] += found[at - (at % columns)];
      else if (at) found[at] += found[at - columns];
    }
    return found;
  };
  const VIRIDIS = [[68, 1, 84], [72, 40, 120], [62, 74, 137], [49, 104, 142], [38, 130, 142], [31, 158, 137], [53, 183, 121], [109, 205, 89], [180, 222, 44], [253, 231, 37]];
  const tint = (share) => {
    const at = Math.min(Math.max(share, 0), 1) * (VIRIDIS.length - 1), low = Math.min(Math.floor(at), VIRIDIS.length - 2);
    return VIRIDIS[low].map((part, k) => part + (at - low) * (VIRIDIS[low + 1][k] - part));
  };
  const written = (value, digits = 3) => `${Number(value.toPrecision(digits))}`;
  const colour = (name) => getComputedStyle(place).getPropertyValue(name).trim();
  const make = (tag, parent, options = {}) => Object.assign(parent.appendChild(document.createElement(tag)), options);

  const surfaces = data.surfaces.map((surface) => ({
    points: rows(Float32Array, surface.points), triangles: corners(surface.triangles),
    glass: surface.glass && corners(surface.glass), edges: corners(surface.edges),
  }));
  const states = data.states.map((state) => {
    const displacement = rounded(state.displacement);
    const size = Float32Array.from({ length: displacement.length / 3 }, (_, k) => Math.hypot(...displacement.subarray(3 * k, 3 * k + 3)));
    const values = state.values ? rounded(state.values) : size, largest = values.reduce((a, b) => Math.max(a, b), 0);
    return { ...state, displacement, size, values, limit: state.limit || largest };
  });

  // What the reader sets, all of it reached by keyboard.
  place.setAttribute("role", "group");
  place.setAttribute("aria-label", text);
  const bar = make("div", place, { className: "tools" });
  const labelled = (words, control) => {
    const label = make("label", bar, { textContent: `${words} ` });
    label.append(control);
    return control;
  };
  const which = labelled("Show", document.createElement("select"));
  states.forEach((state, index) => which.add(new Option(state.name, index)));
  const slider = labelled("", Object.assign(document.createElement("input"), { type: "range", min: 0, max: 100, value: 100, step: 1 }));
  const word = document.createElement("span");
  slider.before(word);
  const output = make("output", slider.parentElement);
  output.setAttribute("aria-live", "off"); // the slider says its value itself
  const play = make("button", bar, { type: "button", textContent: "Play" });
  const drawn = labelled("Drawn", document.createElement("select"));
  const front = make("button", bar, { type: "button", textContent: "Front" });
  const reset = make("button", bar, { type: "button", textContent: "Reset view" });

  const box = make("div", place, { className: "scene", tabIndex: 0 });
  box.setAttribute("role", "img");
  box.setAttribute("aria-label", `${text} Arrow keys turn, plus and minus zoom.`);
  const renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
  renderer.outputColorSpace = "srgb-linear"; // colours as the legend has them: nothing is converted on the way
  box.append(renderer.domElement);
  const ruler = make("div", box, { className: "ruler" });
  const triad = box.appendChild(document.createElementNS("http://www.w3.org/2000/svg", "svg"));
  triad.setAttribute("class", "triad");
  triad.setAttribute("viewBox", "-34 -34 68 68");
  triad.setAttribute("aria-hidden", "true");
  const legend = make("div", place, { className: "legend" });
  const note = make("p", place, { className: "hint" });
  const reading = make("p", place, { className: "reading", textContent: "Drag turns; a click on the part reads its value." });
  reading.setAttribute("role", "status");

  const scene = new THREE.Scene(), camera = new THREE.OrthographicCamera(), toward = new THREE.Vector3(...data.toward).normalize();
  const sun = new THREE.DirectionalLight(0xffffff, 1.1), marker = new THREE.Mesh(new THREE.SphereGeometry(1, 16, 12), new THREE.MeshBasicMaterial({ color: 0xd62728 }));
  scene.add(new THREE.AmbientLight(0xffffff, 2.3), camera, marker);
  camera.add(sun);
  sun.position.set(0.4, 0.6, 1);
  marker.visible = false;

  const bodies = surfaces.map((surface) => {
    const moved = new THREE.BufferAttribute(surface.points.slice(), 3), tints = new THREE.BufferAttribute(new Uint8Array(surface.points.length), 3, true);
    const skin = new THREE.BufferGeometry(), lines = new THREE.BufferGeometry(), rest = new THREE.BufferGeometry();
    skin.setAttribute("position", moved).setAttribute("color", tints).setIndex(new THREE.BufferAttribute(surface.triangles, 1));
    lines.setAttribute("position", moved).setIndex(new THREE.BufferAttribute(surface.edges, 1));
    rest.setAttribute("position", new THREE.BufferAttribute(surface.points, 3)).setIndex(new THREE.BufferAttribute(surface.edges, 1));
    const mesh = new THREE.Mesh(skin, new THREE.MeshLambertMaterial({ vertexColors: true, flatShading: true, side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 }));
    const outline = new THREE.LineSegments(lines, new THREE.LineBasicMaterial({ transparent: true, opacity: 0.55 }));
    const ghost = new THREE.LineSegments(rest, new THREE.LineBasicMaterial({ color: 0x8a949e, transparent: true, opacity: 0.5 }));
    const parts = [mesh, outline, ghost];
    if (surface.glass) {
      const clear = new THREE.BufferGeometry();
      clear.setAttribute("position", moved).setIndex(new THREE.BufferAttribute(surface.glass, 1));
      parts.push(new THREE.Mesh(clear, new THREE.MeshBasicMaterial({ color: 0x8a949e, transparent: true, opacity: 0.1, depthWrite: false, side: THREE.DoubleSide })));
    }
    parts.forEach((part) => { part.frustumCulled = false; scene.add(part); });
    mesh.geometry.computeBoundingBox();
    return { surface, moved, tints, mesh, outline, parts };
  });

  const bounds = bodies[0].mesh.geometry.boundingBox, centre = bounds.getCenter(new THREE.Vector3()), reach = bounds.getSize(new THREE.Vector3()).length();
  const controls = new THREE.OrbitControls(camera, renderer.domElement);
  controls.enableZoom = false; // the wheel scrolls the page until the view has the focus
  box.addEventListener("focusin", () => { controls.enableZoom = true; });
  box.addEventListener("focusout", () => { controls.enableZoom = false; });
  renderer.domElement.addEventListener("pointerdown", () => box.focus({ preventScroll: true }));

  // Half the height of the view that holds the whole part, seen as the camera sees it.
  function half() {
    const corner = new THREE.Vector3();
    let wide = 0, high = 0;
    for (let k = 0; k < 8; k++) {
      corner.set(...["x", "y", "z"].map((axis, bit) => (k & (1 << bit) ? bounds.max : bounds.min)[axis])).sub(centre);
      corner.applyQuaternion(camera.quaternion.clone().invert());
      wide = Math.max(wide, Math.abs(corner.x));
      high = Math.max(high, Math.abs(corner.y));
    }
    return 1.15 * Math.max(high, wide * box.clientHeight / Math.max(box.clientWidth, 1), 1e-9);
  }
  let size = 1;
  function aim(direction) {
    camera.up.set(...data.up);
    controls.target.copy(centre);
    camera.position.copy(centre).addScaledVector(direction, 3 * reach);
    camera.zoom = 1;
    camera.lookAt(centre);
    camera.updateMatrixWorld();
    size = half();
    frame();
    controls.update();
    render();
  }
  function frame() {
    const wide = Math.max(box.clientWidth, 100), high = Math.max(box.clientHeight, 100);
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    renderer.setSize(wide, high);
    Object.assign(camera, { left: -size * wide / high, right: size * wide / high, top: size, bottom: -size, near: 0.01 * reach, far: 6 * reach });
    camera.updateProjectionMatrix();
  }

  let waits = false;
  function render() {
    if (waits) return;
    waits = true;
    requestAnimationFrame(() => {
      waits = false;
      marker.scale.setScalar(0.012 * size / camera.zoom);
      renderer.render(scene, camera);
      measure();
    });
  }
  function measure() {
    const pixel = 2 * size / camera.zoom / box.clientHeight, most = 0.28 * box.clientWidth * pixel, power = 10 ** Math.floor(Math.log10(most));
    const length = power * [5, 2, 1].find((step) => step * power <= most);
    ruler.style.width = `${length / pixel}px`;
    ruler.textContent = length < 0.1 ? `${written(1000 * length)} µm` : `${written(length)} mm`;
    const turn = camera.quaternion.clone().invert();
    triad.innerHTML = ["x", "y", "z"].map((name, k) => {
      const end = new THREE.Vector3(...[0, 1, 2].map((each) => (each === k ? 1 : 0))).applyQuaternion(turn), hue = ["#d0506a", "#3f9c4d", "#0b84b5"][k];
      return `<line x2="${20 * end.x}" y2="${-20 * end.y}" stroke="${hue}" stroke-width="2"/><text x="${28 * end.x - 3}" y="${-28 * end.y + 4}" fill="${hue}">${name}</text>`;
    }).join("");
  }

  let state = states[0], body = bodies[0], picked = null;
  const share = () => (state.slider === "load" ? slider.value / 100 : Math.cos(slider.value * Math.PI / 180));
  function choose() {
    state = states[which.value];
    body = bodies[state.surface];
    bodies.forEach((each) => each.parts.forEach((part) => { part.visible = each === body; }));
    const load = state.slider === "load";
    word.textContent = load ? "load" : "phase";
    slider.max = load ? 100 : 360;
    slider.value = load ? 100 : 0;
    slider.setAttribute("aria-label", load ? `load, per cent of ${state.full}` : "phase of the mode, degrees");
    drawn.replaceChildren(...[...new Set([1, state.enlarged, 2 * state.enlarged])].map((times) => new Option(`${written(times)} ×`, times)));
    drawn.value = state.enlarged;
    drawn.parentElement.hidden = !load; // a mode has no size of its own
    picked = null;
    marker.visible = false;
    reading.textContent = "Drag turns; a click on the part reads its value.";
    const stops = VIRIDIS.map((each) => `rgb(${each.join()})`).join();
    const ticks = [0, 0.25, 0.5, 0.75, 1].map((at) => `<span>${written(at * state.limit)}</span>`).join("");
    legend.innerHTML = `<div class="ramp" style="background: linear-gradient(90deg, ${stops})"></div><div class="ticks">${ticks}</div><div class="what"></div>`;
    legend.lastChild.textContent = state.unit ? `${state.label} [${state.unit}]` : state.label;
    update();
  }
  function update() {
    const now = share(), scale = now * drawn.value / 1000, { points } = body.surface, to = body.moved.array, tints = body.tints.array;
    const level = Math.abs(now);
    for (let k = 0; k < points.length; k++) to[k] = points[k] + scale * state.displacement[k];
    for (let k = 0; k < state.values.length; k++) tints.set(tint(level * state.values[k] / state.limit), 3 * k);
    body.moved.needsUpdate = body.tints.needsUpdate = true;
    output.textContent = state.slider === "load" ? `${slider.value} %` : `${slider.value}°`;
    note.textContent = state.slider === "load"
      ? `${slider.value} % of ${state.full}, linear solution; displacements drawn ${written(Number(drawn.value))} times as large.`
      : "A mode has no size of its own: how large it is drawn says nothing.";
    if (picked) read();
    render();
  }

  // A click reads between the corners of the triangle that it hits.
  const ray = new THREE.Raycaster();
  function pick(x, y) {
    const seen = renderer.domElement.getBoundingClientRect();
    ray.setFromCamera(new THREE.Vector2(2 * (x - seen.left) / seen.width - 1, 1 - 2 * (y - seen.top) / seen.height), camera);
    body.mesh.geometry.computeBoundingSphere();
    const hit = ray.intersectObject(body.mesh)[0];
    if (!hit) return;
    const corners = [hit.face.a, hit.face.b, hit.face.c], [a, b, c] = corners.map((k) => new THREE.Vector3().fromArray(body.moved.array, 3 * k));
    const area = (p, q, r) => q.clone().sub(p).cross(r.clone().sub(p)).length(), whole = area(a, b, c);
    picked = { corners, weights: [area(hit.point, b, c), area(hit.point, c, a), area(hit.point, a, b)].map((each) => each / whole) };
    read();
    render();
  }
  function read() {
    const mean = (array, width, part) => picked.corners.reduce((sum, k, n) => sum + picked.weights[n] * array[width * k + part], 0);
    const now = share(), triple = (array, factor) => [0, 1, 2].map((part) => written(factor * mean(array, 3, part))).join(", ");
    const value = Math.abs(now) * mean(state.values, 1, 0);
    const own = `${state.label}: ${written(value, 4)} ${state.unit}`.trim();
    const more = state.slider === "phase" ? "" : `; displacement (${triple(state.displacement, now)}) µm`;
    reading.textContent = `${own}${more}; at (${triple(body.surface.points, 1)}) mm`;
    marker.position.set(...[0, 1, 2].map((part) => mean(body.moved.array, 3, part)));
    marker.visible = true;
  }
  let pressed = null;
  renderer.domElement.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; });
  renderer.domElement.addEventListener("pointerup", (event) => {
    if (pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 5) pick(event.clientX, event.clientY);
  });

  function turn(across, up) {
    const away = camera.position.clone().sub(centre), pole = new THREE.Vector3(...data.up).normalize();
    away.applyAxisAngle(pole, across);
    const side = pole.clone().cross(away).normalize(), raised = away.clone().applyAxisAngle(side, up);
    if (Math.abs(raised.clone().normalize().dot(pole)) < 0.995) away.copy(raised);
    camera.position.copy(centre).add(away);
    controls.target.copy(centre);
    controls.update();
    render();
  }
  box.addEventListener("keydown", (event) => {
    const zoom = (factor) => { camera.zoom *= factor; camera.updateProjectionMatrix(); render(); };
    const act = {
      ArrowLeft: () => turn(-0.12, 0), ArrowRight: () => turn(0.12, 0), ArrowUp: () => turn(0, -0.12), ArrowDown: () => turn(0, 0.12),
      "+": () => zoom(1.2), "=": () => zoom(1.2), "-": () => zoom(1 / 1.2), 0: () => aim(toward),
    }[event.key];
    if (act) { event.preventDefault(); act(); }
  });

  let running = 0;
  function step(time) {
    if (!running) return;
    const phase = ((time - running) / 2000) % 1;
    slider.value = state.slider === "load" ? 50 - 50 * Math.cos(2 * Math.PI * phase) : 360 * phase;
    update();
    requestAnimationFrame(step);
  }
  play.addEventListener("click", () => {
    running = running ? 0 : performance.now();
    play.textContent = running ? "Pause" : "Play";
    if (running) requestAnimationFrame(step);
  });
  which.addEventListener("change", choose);
  slider.addEventListener("input", update);
  drawn.addEventListener("change", update);
  front.addEventListener("click", () => aim(new THREE.Vector3(...(data.up[2] ? [0, -1, 0.001] : [0, 0.001, 1]))));
  reset.addEventListener("click", () => aim(toward));
  controls.addEventListener("change", render);
  new ResizeObserver(() => { if (box.clientWidth) { frame(); render(); } }).observe(box);
  const dark = matchMedia("(prefers-color-scheme: dark)"), ink = () => { bodies.forEach((each) => each.outline.material.color.set(colour("--ink"))); render(); };
  dark.addEventListener("change", ink);
  ink();
  choose();
  aim(toward);
  return { positions: () => body.moved.array, points: surfaces[0].points, triangles: surfaces[0].triangles, camera, pick, states };
}
