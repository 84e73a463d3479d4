// What a report does in addition to being read: contents that follow, tables that sort, folds that open for print, live pictures.
"use strict";

(() => {
  const kinds = { traces: typeof showTraces === "function" && showTraces, view: typeof showView === "function" && showView };
  document.documentElement.classList.add("scripted");

  // Arrays of flexdesign.report.packed: inflated, row by row again.
  async function inflated({ deflated, columns }) {
    const packed = Uint8Array.from(atob(deflated), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    return { bytes: await new Response(stream).arrayBuffer(), columns };
  }
  async function unpacked(data) {
    if (data === null || typeof data !== "object") return data;
    if ("deflated" in data) return inflated(data);
    const entries = await Promise.all(Object.entries(data).map(async ([key, value]) => [key, await unpacked(value)]));
    return Array.isArray(data) ? entries.map(([, value]) => value) : Object.fromEntries(entries);
  }

  // Live pictures, made when they come near; where one fails its drawing stays.
  async function enliven(figure) {
    const source = figure.querySelector("script.data");
    if (!source || figure.live) return;
    let data;
    try {
      data = await unpacked(JSON.parse(source.textContent));
    } catch (error) {
      figure.live = { error };
      console.warn(`The drawing stays: ${error.message}`);
      return;
    }
    const place = document.createElement("div");
    place.className = `live ${source.dataset.kind}`;
    figure.prepend(place);
    figure.classList.add("on");
    try {
      figure.live = kinds[source.dataset.kind](place, data, figure.querySelector("img").alt);
    } catch (error) {
      figure.classList.remove("on");
      place.remove();
      figure.live = { error };
      console.warn(`The drawing stays: ${error.message}`);
    }
  }
  const near = new IntersectionObserver((entries) => {
    for (const entry of entries) if (entry.isIntersecting) { near.unobserve(entry.target); enliven(entry.target); }
  }, { rootMargin: "400px" });
  document.querySelectorAll("figure:has(script.data)").forEach((figure) => near.observe(figure));

  // Contents: the section at the top of the window is marked.
  const links = [...document.querySelectorAll("nav.contents a")], list = document.querySelector("nav.contents details");
  const sections = links.map((link) => document.querySelector(link.hash));
  const wide = matchMedia("(min-width: 1100px)");
  const fit = () => { if (list) list.open = wide.matches; };
  wide.addEventListener("change", fit);
  fit();
  let waits = false;
  function mark() {
    waits = false;
    let now = -1;
    sections.forEach((section, index) => { if (section.getBoundingClientRect().top < 140) now = index; });
    if (innerHeight + scrollY >= document.documentElement.scrollHeight - 2 && scrollY > 0) {
      // At the end several sections are in sight, of which the one that was asked for is meant.
      const asked = sections.findIndex((section) => `#${section.id}` === location.hash);
      now = asked >= 0 && sections[asked].getBoundingClientRect().top > 0 ? asked : sections.length - 1;
    }
    links.forEach((link, index) => {
      if (index === now) link.setAttribute("aria-current", "true"); else link.removeAttribute("aria-current");
    });
    const name = document.querySelector("nav.contents .now");
    if (name) name.textContent = now < 0 ? "" : links[now].textContent;
    if (now >= 0 && wide.matches) {
      const box = list, link = links[now];
      if (link.offsetTop < box.scrollTop || link.offsetTop + link.offsetHeight > box.scrollTop + box.clientHeight)
        box.scrollTop = link.offsetTop - box.clientHeight / 2;
    }
  }
  addEventListener("scroll", () => { if (!waits) { waits = true; requestAnimationFrame(mark); } }, { passive: true });
  mark();
  function unfold() {
    const target = document.getElementById(location.hash.slice(1));
    target?.querySelector(":scope > details")?.setAttribute("open", "");
  }
  links.forEach((link) => link.addEventListener("click", () => {
    document.querySelector(link.hash).querySelector(":scope > details")?.setAttribute("open", "");
    if (!wide.matches) list.open = false;
  }));
  addEventListener("hashchange", unfold);
  unfold();

  // Paper has no folds.
  let closed = [];
  const open = () => { closed = [...document.querySelectorAll("section details:not([open])")]; closed.forEach((d) => { d.open = true; }); };
  const close = () => { closed.forEach((d) => { d.open = false; }); closed = []; };
  addEventListener("beforeprint", open);
  addEventListener("afterprint", close);
  document.querySelector("button.unfold")?.addEventListener("click", (event) => {
    const shut = document.querySelectorAll("section details:not([open])"), any = shut.length > 0;
    (any ? shut : document.querySelectorAll("section details")).forEach((d) => { d.open = any; });
    event.target.textContent = any ? "Fold sections" : "Unfold all sections";
  });

  // Tables sort by number, whatever its prefix: 900 nm comes before 1.2 µm. What is no number comes last.
  const PREFIX = { p: 1e-12, n: 1e-9, u: 1e-6, "µ": 1e-6, m: 1e-3, k: 1e3, M: 1e6, G: 1e9 };
  const BASE = /^(m|N|Hz|s|V|Pa|g|rad|F|A|W|J)(?![A-Za-z])/;
  function scaled(unit) {
    let factor = 1, below = false;
    const base = unit.split(/([/·* ])/).map((part) => {
      if (part === "/") below = true;
      let name = part;
      if (!BASE.test(part) && part[0] in PREFIX && BASE.test(part.slice(1))) {
        name = part.slice(1);
        const power = Number((name.match(/[²2]$/) && 2) || (name.match(/[³3]$/) && 3) || 1);
        factor *= PREFIX[part[0]] ** (below ? -power : power);
      }
      return name;
    }).join("");
    return [factor, base];
  }
  function value(text) {
    const plain = text.trim().replace(/−/g, "-");
    const found = plain.match(/^[(<>≤≥~≈+ ]*(-?\d[\d ]*(?:\.\d+)?(?:e[+-]?\d+)?)(?:\s*±\s*[\d.]+(?:e[+-]?\d+)?)?\s*([^\s,;()]*)/i);
    if (!found) return null;
    const [factor, base] = scaled(found[2]);
    return [base, Number(found[1].replace(/ /g, "")) * factor];
  }
  function sort(table, column, direction) {
    const body = table.tBodies[0];
    const rows = [...body.rows].map((row) => ({ row, text: row.cells[column].textContent, value: value(row.cells[column].textContent) }));
    const numbers = rows.filter((each) => each.value).length * 2 >= rows.filter((each) => !/^\s*–?\s*$/.test(each.text)).length;
    const key = (a, b) => {
      if (!numbers) return direction * a.text.localeCompare(b.text, undefined, { numeric: true });
      if (!a.value || !b.value) return (a.value ? 0 : 1) - (b.value ? 0 : 1);
      return direction * (a.value[0].localeCompare(b.value[0]) || a.value[1] - b.value[1]);
    };
    rows.sort((a, b) => (direction ? key(a, b) : 0) || a.row.place - b.row.place);
    body.append(...rows.map((each) => each.row));
  }
  document.querySelectorAll("main table").forEach((table) => {
    if (!table.tHead || table.tBodies[0].rows.length < 3) return;
    [...table.tBodies[0].rows].forEach((row, place) => { row.place = place; });
    const heads = [...table.tHead.rows[0].cells];
    heads.forEach((head, column) => {
      if (!head.textContent.trim()) return;
      const button = document.createElement("button");
      button.type = "button";
      button.append(...head.childNodes);
      button.title = "Sort by this column";
      head.append(button);
      head.setAttribute("aria-sort", "none");
      button.addEventListener("click", () => {
        const next = { none: "ascending", ascending: "descending", descending: "none" }[head.getAttribute("aria-sort")];
        heads.forEach((other) => { if (other.hasAttribute("aria-sort")) other.setAttribute("aria-sort", "none"); });
        head.setAttribute("aria-sort", next);
        sort(table, column, { none: 0, ascending: 1, descending: -1 }[next]);
      });
    });
  });
})();
