// The pictures of cause.html. A row of the data is a scene of the event log:
// [second, FID, line, state after it (-1 not repeated here, -2 dark), leases, [[id, copies], ...] sent, [id, why nothing came of it] got,
//  [[until, cells]] flown]. The lines are those of `swarmer explain`.
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const [T, FID, LINE, STATE, LEASES, SENT, GOT, FLOWN] = [0, 1, 2, 3, 4, 5, 6, 7];
  const rows = data.rows, ROW = 22, LANE = 34, TOP = 26, MOST_ROWS = 250, MOST_LANES = 10;
  const end = Math.max(1e-6, ...data.rises.map((rise) => rise.to), rows.length ? rows[rows.length - 1][T] : 0);
  const whole = new Set(data.whole);
  const latest = new Map();
  for (const row of rows) { // where a row does not repeat the state, it is still what it was
    const before = latest.get(row[FID]);
    if (row[STATE] === -1 && before) [row[STATE], row[LEASES]] = before;
    latest.set(row[FID], [row[STATE], row[LEASES]]);
  }
  const find = (id) => document.getElementById(id);

  function svg(name, attributes, text) {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text !== undefined) made.textContent = text;
    return made;
  }

  // -- who talks to whom: a lane for each FLS, an event a row, beside its line of the story --------------------------

  function talkOf(fids, from, to) {
    const chosen = new Set(fids), theirs = new Set(), heard = new Set();
    const inside = rows.filter((row) => row[T] >= from && row[T] <= to);
    for (const row of inside) {
      if (!chosen.has(row[FID])) continue;
      row[SENT].forEach(([id]) => theirs.add(id));
      if (row[GOT].length) heard.add(row[GOT][0]);
    }
    return inside.filter((row) => chosen.has(row[FID]) || theirs.has(row[GOT][0])
      || row[SENT].some(([id]) => heard.has(id)));
  }

  function lanesOf(shown, fids) {
    const counts = new Map();
    for (const row of shown) counts.set(row[FID], (counts.get(row[FID]) || 0) + 1);
    const others = [...counts.keys()].filter((fid) => !fids.includes(fid)).sort((a, b) => counts.get(b) - counts.get(a));
    return [...fids, ...others].slice(0, Math.max(MOST_LANES, fids.length));
  }

  function picture(shown, fids, label) {
    const lanes = lanesOf(shown, fids), place = new Map(lanes.map((fid, i) => [fid, LANE * (i + 0.5)]));
    const height = TOP + ROW * shown.length + 6;
    const drawn = svg("svg", { width: LANE * lanes.length + 4, height, role: "img", "aria-label": label });
    const y = (i) => TOP + ROW * (i + 0.5);
    const sentAt = new Map(), known = new Map();
    for (const fid of lanes) {
      drawn.append(svg("line", { x1: place.get(fid), x2: place.get(fid), y1: TOP, y2: height, stroke: "var(--grid)" }));
      drawn.append(svg("text", { x: place.get(fid), y: 17, "text-anchor": "middle" }, fid));
    }
    const bars = svg("g", {}), arrows = svg("g", {}), dots = svg("g", {});
    drawn.append(bars, arrows, dots);
    const lasts = (fid, i) => {
      const before = known.get(fid);
      if (before && before.state >= 0) {
        bars.append(svg("rect", { x: place.get(fid) - 4, width: 8, y: y(before.row), height: y(i) - y(before.row),
          fill: `var(--s${before.state})` }));
      }
    };
    shown.forEach((row, i) => {
      const x = place.get(row[FID]);
      if (row[GOT].length) arrow(arrows, sentAt.get(row[GOT][0]), place, row, x, y(i));
      for (const [id, copies] of row[SENT]) {
        sentAt.set(id, { x, y: y(i) });
        if (copies === 0 && x !== undefined) cross(arrows, x + 11, y(i));
      }
      if (x === undefined) return;
      lasts(row[FID], i);
      known.set(row[FID], { state: row[STATE], row: i });
      dots.append(svg("circle", { cx: x, cy: y(i), r: 4.5, fill: row[STATE] < 0 ? "var(--ground)" : `var(--s${row[STATE]})`,
        stroke: "var(--ink)" }));
      if (row[FLOWN].length) {
        dots.append(svg("path", { d: `M${x + 7} ${y(i) + 4}l5 -8l5 8z`, fill: "var(--accent)" }));
      }
    });
    for (const fid of lanes) lasts(fid, shown.length - 1);
    return drawn;
  }

  function arrow(group, from, place, row, x, y) {
    const lost = row[GOT][1].startsWith("lost"), vain = row[GOT][1] !== "" && !lost;
    const sender = Number(row[GOT][0].split(".")[0]);
    const start = from && from.x !== undefined ? from : place.has(sender) ? { x: place.get(sender), y } : undefined;
    if (x === undefined || start === undefined || start.x === x) return;
    const side = Math.sign(x - start.x), tip = x - side * 6;
    const kind = lost ? "lost" : vain ? "vain" : "went";
    group.append(svg("path", { d: `M${start.x} ${start.y}L${tip} ${y}m${-side * 5} -3.5L${tip} ${y}l${-side * 5} 3.5`,
      class: kind, fill: "none", "stroke-width": 1.2, "stroke-dasharray": lost ? "4 3" : "none" }));
    if (lost) cross(group, tip - side * 8, y);
  }

  function cross(group, x, y) {
    group.append(svg("path", { d: `M${x - 4} ${y - 4}l8 8m0 -8l-8 8`, class: "lost", "stroke-width": 2 }));
  }

  function lineOf(row, spare) {
    const item = document.createElement("li");
    for (const part of row[LINE].slice(spare).split(/(\[\d+\.\d+#\d+\])/)) {
      if (/^\[\d+\.\d+#\d+\]$/.test(part)) {
        const button = document.createElement("button");
        button.type = "button";
        button.textContent = part.slice(1, -1);
        button.addEventListener("click", () => { find("message").value = button.textContent; follow(true); });
        item.append("[", button, "]");
      } else {
        item.append(part);
      }
    }
    return item;
  }

  function talk(shown, fids, label) {
    const frame = document.createElement("div"), list = document.createElement("ol");
    frame.className = "talk";
    frame.tabIndex = 0;
    frame.setAttribute("role", "group");
    frame.setAttribute("aria-label", label);
    const first = shown.slice(0, MOST_ROWS), spare = Math.min(...first.map((row) => row[LINE].search(/\S/)));
    first.forEach((row) => list.append(lineOf(row, spare)));
    frame.append(picture(first, fids, `${label}: lanes ${lanesOf(first, fids).join(", ")}`), list);
    const hint = document.createElement("span"), whole = document.createElement("div");
    hint.className = "narrow";
    hint.textContent = "Wider than this screen: what was said stands to the right of the lanes.";
    whole.append(hint, frame);
    requestAnimationFrame(() => { if (frame.scrollWidth <= frame.clientWidth) hint.remove(); });
    return whole;
  }

  // -- the life of one FLS on a line ---------------------------------------------------------------------------------

  function life(fid, from, to) {
    const width = Math.max(280, find("life").clientWidth), left = 74, room = width - left - 4;
    const own = rows.filter((row) => row[FID] === fid), x = (t) => left + room * Math.min(t, end) / end;
    const drawn = svg("svg", { width, height: 132, role: "img", "aria-label":
      `FLS ${fid}: ${own.filter((row) => row[FLOWN].length).length} flights, `
      + `${own.reduce((sum, row) => sum + row[SENT].length, 0)} datagrams sent, `
      + `${own.filter((row) => row[GOT].length && !row[GOT][1].startsWith("lost")).length} received, `
      + `${own.filter(isLost).length} lost` });
    ["state", "leases", "flights", "sent", "received", "lost"].forEach((name, i) =>
      drawn.append(svg("text", { x: left - 8, y: 15 + 18 * i, "text-anchor": "end" }, name)));
    own.forEach((row, i) => {
      const until = i + 1 < own.length ? own[i + 1][T] : end, span = Math.max(0.5, x(until) - x(row[T]));
      const bar = (y, height, fill) => drawn.append(svg("rect", { x: x(row[T]), width: span, y, height, fill }));
      if (row[STATE] >= 0) bar(4, 14, `var(--s${row[STATE]})`);
      if (row[LEASES] > 0) bar(36 - Math.min(14, 4 * row[LEASES]), Math.min(14, 4 * row[LEASES]), "var(--s2)");
      if (row[FLOWN].length) {
        drawn.append(svg("rect", { x: x(row[T]), width: Math.max(1.5, x(row[FLOWN][0][0]) - x(row[T])), y: 42, height: 10,
          fill: "var(--accent)" }));
      }
      const tick = (y, stroke) => drawn.append(svg("line", { x1: x(row[T]), x2: x(row[T]), y1: y, y2: y + 12, stroke }));
      if (row[SENT].length) tick(58, "var(--ink)");
      if (isLost(row)) tick(94, "var(--warn)");
      else if (row[GOT].length) tick(76, "var(--ink)");
    });
    drawn.append(svg("rect", { x: x(from), width: Math.max(2, x(to) - x(from)), y: 1, height: 110, fill: "none",
      stroke: "var(--warn)", "stroke-width": 1.5 }));
    for (let i = 0; i <= 4; i += 1) {
      drawn.append(svg("text", { x: x(end * i / 4), y: 127, "text-anchor": i === 4 ? "end" : "middle" },
        `${Number((end * i / 4).toPrecision(3))} s`));
    }
    drawn.addEventListener("click", (event) => {
      const at = (event.clientX - drawn.getBoundingClientRect().left - left) / room * end;
      shift(at - (from + to) / 2, 1);
    });
    return drawn;
  }

  const isLost = (row) => (row[GOT].length && row[GOT][1].startsWith("lost")) || row[SENT].some(([, copies]) => copies === 0);

  // -- what was chosen -----------------------------------------------------------------------------------------------

  function chosen() {
    const fids = find("fls").value.split(/[\s,]+/).filter(Boolean).map(Number);
    const good = fids.length > 0 && fids.length <= 8 && fids.every((fid) => Number.isInteger(fid) && fid >= 1 && fid <= data.points);
    const from = Number(find("from").value), to = Number(find("to").value);
    find("fls").setAttribute("aria-invalid", String(!good));
    find("to").setAttribute("aria-invalid", String(!(to >= from)));
    return good && to >= from ? { fids: [...new Set(fids)], from, to } : null;
  }

  function show() {
    const choice = chosen();
    if (!choice) {
      find("said").textContent = `Give FIDs of this run, 1 to ${data.points}, at most 8, as 17,40; and an end that is not before the beginning.`;
      return;
    }
    const { fids, from, to } = choice, shown = talkOf(fids, from, to);
    const absent = fids.filter((fid) => !whole.has(fid));
    let said = shown.length ? `${shown.length} event${shown.length === 1 ? "" : "s"} of FLS ${fids.join(", ")} and of those it talked with`
      : `Nothing of FLS ${fids.join(", ")} in these seconds`;
    if (shown.length > MOST_ROWS) said += `; the first ${MOST_ROWS} are shown`;
    if (absent.length) said += `. This page does not hold the whole life of FLS ${absent.join(", ")}`;
    find("said").textContent = `${said}.`;
    find("life").replaceChildren(life(fids[0], from, to));
    find("talk").replaceChildren(...(shown.length ? [talk(shown, fids, "who talks to whom")] : []));
  }

  function shift(by, scale) {
    const choice = chosen();
    if (!choice) return;
    const half = Math.min(end, Math.max(0.002, (choice.to - choice.from) * scale)) / 2;
    const middle = Math.min(end - half, Math.max(half, (choice.from + choice.to) / 2 + by));
    find("from").value = (middle - half).toFixed(4);
    find("to").value = (middle + half).toFixed(4);
    show();
  }

  function follow(move) {
    const id = find("message").value.trim();
    const about = rows.filter((row) => row[LINE].includes(`[${id}]`) || row[LINE].includes(`: ${id}`));
    const from = about.find((row) => row[SENT].some(([sent]) => sent === id));
    find("heard").textContent = about.length
      ? `${about.length} events name ${id}` + (from ? "" : "; when it was sent is not among them") + "."
      : `Nothing here names ${id}.`;
    const fids = [...new Set(about.map((row) => row[FID]))].slice(0, 8);
    find("followed").replaceChildren(...(about.length ? [talk(about, fids, `the life of ${id}`)] : []));
    if (move) find("heard").scrollIntoView({ block: "nearest" });
  }

  function begin() {
    const first = data.rises[0], cast = first && first.cast.length ? first.cast : data.whole;
    if (cast.length) find("fls").value = cast[0];
    find("from").value = (first ? first.from : 0).toFixed(4);
    find("to").value = (first ? first.to : Math.min(end, 1)).toFixed(4);
    find("choice").addEventListener("submit", (event) => { event.preventDefault(); show(); });
    find("asked").addEventListener("submit", (event) => { event.preventDefault(); follow(false); });
    for (const button of document.querySelectorAll("[data-move]")) {
      button.addEventListener("click", () => {
        const choice = chosen();
        if (choice) shift(Number(button.dataset.move) * 0.75 * (choice.to - choice.from), 1);
      });
    }
    for (const button of document.querySelectorAll("[data-scale]")) {
      button.addEventListener("click", () => shift(0, Number(button.dataset.scale)));
    }
    for (const place of document.querySelectorAll("[data-rise]")) {
      const rise = data.rises[Number(place.dataset.rise)];
      const shown = rows.filter((row) => row[T] >= rise.from && row[T] <= rise.to && rise.cast.includes(row[FID]));
      if (shown.length) place.replaceChildren(talk(shown, rise.cast, "who talks to whom"));
    }
    const named = () => {
      const part = /^#rise-\d+$/.test(location.hash) && document.querySelector(location.hash);
      if (part) { part.open = true; part.scrollIntoView(); }
    };
    window.addEventListener("hashchange", named);
    window.addEventListener("resize", () => { const choice = chosen(); if (choice) find("life").replaceChildren(life(choice.fids[0], choice.from, choice.to)); });
    show();
    named();
  }

  begin();
})();
