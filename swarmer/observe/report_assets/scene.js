"use strict";
// The points in space, through time. Data: see report_scene.py. Other parts of the page may listen to `swarmer:time`
// (detail: seconds, when the moment shown changes) and send `swarmer:seek` (detail: seconds) on the document.
(async () => {
  const figure = document.getElementById("scene");
  if (!figure) return;
  const canvas = figure.querySelector("canvas"), slider = figure.querySelector("[type=range]");
  const play = figure.querySelector("[data-do=play]"), reset = figure.querySelector("[data-do=reset]");
  const moved = figure.querySelector("[type=checkbox]"), speed = figure.querySelector("select"), words = figure.querySelector("output");
  const facts = JSON.parse(document.getElementById("scene-facts").textContent);
  const bytes = (text) => Uint8Array.from(atob(text.trim()), (c) => c.charCodeAt(0));
  const { times, hd, swarms, lit, points: F, shapes } = facts, N = times.length, K = shapes.length;
  const frame = (n) => 4 * F * (n + K); // where a frame begins; before them come the points of the K shapes
  const shapeAt = (t) => { let k = 0; while (k + 1 < K && shapes[k + 1] <= t) k++; return k - K; }; // as a frame

  const unpacked = async () => {
    const stream = new Blob([bytes(document.getElementById("scene-data").textContent)]).stream();
    const raw = new Uint8Array(await new Response(stream.pipeThrough(new DecompressionStream("deflate"))).arrayBuffer());
    const half = raw.length / 2, values = new Uint16Array(half);
    for (let i = 0; i < half; i++) values[i] = raw[i] | (raw[half + i] << 8);
    const step = 4 * F; // a frame: x, y, z, colour; each is the difference to the frame before
    for (let i = step; i < half; i++) values[i] += values[i - step];
    return values;
  };
  let data;
  try { data = await unpacked(); } catch (error) {
    words.textContent = "This browser cannot unpack the points; the pictures below show them at two moments.";
    return;
  }
  const colour = (parts) => `rgb(${parts.join()})`, calm = colour(facts.calm), dark = colour(facts.dark);
  const table = (text) => {
    const octets = bytes(text);
    return Array.from({ length: octets.length / 3 }, (_, i) => colour(octets.subarray(3 * i, 3 * i + 3)));
  };
  const vivid = table(facts.vivid), pale = table(facts.pale), members = new Uint32Array(vivid.length);
  const centre = facts.centre, radius = facts.radius;
  const start = { azimuth: facts.view[0], elevation: facts.view[1], zoom: 1 };
  let view = { ...start }, now = times[N - 1], playing = false, before = 0, wanted = false;

  const frameAt = (t) => {
    let low = 0, high = N - 1;
    while (low < high) { const mid = (low + high + 1) >> 1; if (times[mid] <= t) low = mid; else high = mid - 1; }
    return low;
  };
  // The same turn as seen_from in shapes/views.py: height is up, (right, up, near) come out.
  const turned = (x, y, z, out, at) => {
    const turn = view.azimuth * Math.PI / 180, raised = view.elevation * Math.PI / 180;
    const right = x * Math.cos(turn) - z * Math.sin(turn), near = x * Math.sin(turn) + z * Math.cos(turn);
    out[at] = right; out[at + 1] = y * Math.cos(raised) - near * Math.sin(raised);
    out[at + 2] = y * Math.sin(raised) + near * Math.cos(raised);
  };
  const place = new Float32Array(3 * F), order = new Uint32Array(F);
  const put = (one, other, share, shift) => { // where everybody is between two frames
    const a = frame(one), b = frame(other), [sx, sy, sz] = facts.low, step = facts.step;
    for (let i = 0; i < F; i++) {
      const at = (k) => data[a + k * F + i] + (data[b + k * F + i] - data[a + k * F + i]) * share + shift[k];
      turned(sx + step * at(0) - centre[0], sy + step * at(1) - centre[1], sz + step * at(2) - centre[2], place, 3 * i);
    }
  };
  const still = [0, 0, 0];
  const offset = (one, other, share) => { // the mean error of who is lit: what HD moves the display by; in steps
    const a = frame(one), b = frame(other), home = frame(shapeAt(now)), sum = [0, 0, 0];
    let count = 0;
    for (let i = 0; i < F; i++) {
      if (!data[a + 3 * F + i] || !data[home + 3 * F + i]) continue;
      count++;
      for (let k = 0; k < 3; k++) {
        const at = data[a + k * F + i];
        sum[k] += data[home + k * F + i] - at - (data[b + k * F + i] - at) * share;
      }
    }
    return sum.map((total) => total / Math.max(count, 1));
  };

  const reach = [1e-9, 1e-9]; // how far the shapes go to the sides and up and down, as first seen; cells
  for (let k = -K; k < 0; k++) {
    put(k, k, 0, still);
    for (let i = 0; i < F; i++) {
      if (!data[frame(k) + 3 * F + i]) continue;
      for (const axis of [0, 1]) reach[axis] = Math.max(reach[axis], Math.abs(place[3 * i + axis]));
    }
  }

  const draw = () => {
    wanted = false;
    const ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = "#10141c"; pen.fillRect(0, 0, width, height);
    const whole = Math.min(0.46 * width / reach[0], 0.46 * height / reach[1]); // all of it is in the first view
    const scale = Math.min(0.54 * Math.min(width, height * 1.25) / radius, whole) * view.zoom;
    const dot = Math.max(0.8, Math.min(5, 0.38 * facts.spacing * scale));
    const spot = (i, size, colour) => {
      pen.fillStyle = colour;
      const x = width / 2 + scale * place[3 * i], y = height / 2 - scale * place[3 * i + 1];
      if (size < 1.5) { pen.fillRect(x - size, y - size, 2 * size, 2 * size); return; }
      pen.beginPath(); pen.arc(x, y, size, 0, 7); pen.fill();
    };
    const home = shapeAt(now), belongs = frame(home) + 3 * F;
    put(home, home, 0, still); // ground truth
    for (let i = 0; i < F; i++) if (data[belongs + i]) spot(i, 0.45 * dot, "#4b5568");
    const one = frameAt(now), other = Math.min(one + 1, N - 1);
    const share = other > one ? Math.min(1, Math.max(0, (now - times[one]) / (times[other] - times[one]))) : 0;
    put(one, other, share, moved.checked ? offset(one, other, share) : still);
    for (let i = 0; i < F; i++) order[i] = i;
    order.sort((i, j) => place[3 * i + 2] - place[3 * j + 2]);
    const colours = frame(one) + 3 * F, last = frame(Math.max(one - 1, 0)) + 3 * F;
    members.fill(0);
    for (let i = 0; i < F; i++) members[data[colours + i] % vivid.length]++;
    for (const i of order) {
      const swarm = data[colours + i] % vivid.length;
      if (data[colours + i]) spot(i, dot, swarms[one] === 1 ? calm : (members[swarm] > 1 ? vivid : pale)[swarm]);
      else if (data[last + i]) spot(i, 1.6 * dot, "#ff5a4a"); // it has just gone dark
      else spot(i, 0.7 * dot, dark);
    }
    const distance = hd[one] === null ? "no HD yet" : `HD ${Number(hd[one].toPrecision(3))} cells`;
    const text = `${facts.clock.replace("%", times[one].toFixed(facts.digits))}: ${distance}, ` +
      `${swarms[one]} ${swarms[one] === 1 ? "swarm" : "swarms"}, ${lit[one]} of ${facts.all} lit`;
    if (words.textContent !== text) { words.textContent = text; slider.setAttribute("aria-valuetext", text); }
  };
  const redraw = () => { if (!wanted) { wanted = true; requestAnimationFrame(draw); } };

  const show = (t) => {
    now = Math.min(times[N - 1], Math.max(times[0], t));
    slider.value = now; redraw();
    document.dispatchEvent(new CustomEvent("swarmer:time", { detail: now }));
  };
  const run = (on) => {
    playing = on; play.textContent = on ? "Pause" : "Play";
    if (on) { if (now >= times[N - 1]) show(times[0]); before = performance.now(); requestAnimationFrame(tick); }
  };
  const tick = (at) => {
    if (!playing) return;
    show(now + (at - before) / 1000 * Number(speed.value)); before = at;
    if (now >= times[N - 1]) run(false); else requestAnimationFrame(tick);
  };
  const turn = (azimuth, elevation) => {
    view.azimuth += azimuth; view.elevation = Math.max(-90, Math.min(90, view.elevation + elevation)); redraw();
  };

  slider.min = times[0]; slider.max = times[N - 1]; slider.step = N > 1 ? (times[N - 1] - times[0]) / (N - 1) : 1;
  slider.addEventListener("input", () => { run(false); show(Number(slider.value)); });
  play.addEventListener("click", () => run(!playing));
  moved.addEventListener("change", redraw);
  reset.addEventListener("click", () => { view = { ...start }; redraw(); });
  canvas.addEventListener("keydown", (event) => {
    const keys = {
      ArrowLeft: () => turn(6, 0), ArrowRight: () => turn(-6, 0), ArrowUp: () => turn(0, 6), ArrowDown: () => turn(0, -6),
      "+": () => { view.zoom = Math.min(12, view.zoom * 1.2); redraw(); }, "=": () => keys["+"](),
      "-": () => { view.zoom = Math.max(0.2, view.zoom / 1.2); redraw(); }, "0": () => reset.click(),
      " ": () => run(!playing), ",": () => show(times[Math.max(0, frameAt(now) - 1)]),
      ".": () => show(times[Math.min(N - 1, frameAt(now) + 1)]),
    };
    if (keys[event.key] && !event.ctrlKey && !event.metaKey && !event.altKey) { event.preventDefault(); keys[event.key](); }
  });
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId); canvas.style.cursor = "grabbing";
  });
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons) turn(-0.4 * event.movementX, 0.4 * event.movementY);
  });
  canvas.addEventListener("pointerup", () => { canvas.style.cursor = ""; });
  document.addEventListener("swarmer:seek", (event) => { run(false); show(event.detail); });
  new ResizeObserver(redraw).observe(canvas);
  show(times[N - 1]);
  figure.dataset.ready = "yes";
})();
