"use strict";
// Starts rerun's viewer on the recording that this server has. The viewer may ask this server and nobody else: what it
// would send to its makers is refused here, quietly, and by the page's policy in any case.

const status = document.getElementById("status");
const canvas = document.getElementById("viewer");

function say(text) {
  status.textContent = text;
  status.hidden = !text;
}

function fail(reason) {
  canvas.hidden = true;
  say(`The viewer did not start in this browser (${reason}). Another browser may do; in a terminal, ` +
    "swarmer replay --terminal RUN needs none.");
}

const ask = window.fetch.bind(window);
const recordingAddress = new URL("recording.rrd", location.href).href;
// Asked for before the viewer is there: of a run that goes on, what is asked for is sent although the run ends meanwhile.
const recording = ask(recordingAddress);
recording.catch(() => {}); // told when the viewer asks for it

window.fetch = (what, options) => {
  const address = new URL(what instanceof Request ? what.url : what, location.href);
  if (address.href === recordingAddress) return recording.then(told);
  if (address.origin === location.origin) return ask(what, options);
  return Promise.resolve(new Response(null, { status: 204 })); // an empty answer: there is nobody there
};

// The same answer; its end, which is that of a run that went on, is told.
function told(answer) {
  const note = document.getElementById("note");
  const reader = answer.body.getReader();
  const passed = new ReadableStream({
    async pull(sink) {
      try {
        const { done, value } = await reader.read();
        if (!done) return sink.enqueue(value);
        if (note.dataset.over) note.textContent = note.dataset.over;
      } catch {
        note.textContent = "The connection broke: this is what had come.";
      }
      sink.close();
    },
  });
  return new Response(passed, { status: answer.status, headers: answer.headers });
}

async function program() {
  const answer = await fetch("re_viewer_bg.wasm");
  if (!answer.ok) throw new Error(`no viewer: ${answer.status}`);
  const whole = Number(answer.headers.get("Content-Length"));
  const reader = answer.body.getReader();
  let loaded = 0;
  const counted = new ReadableStream({
    async pull(sink) {
      const { done, value } = await reader.read();
      if (done) return sink.close();
      loaded += value.byteLength;
      say(`Loading the viewer … ${Math.round((100 * loaded) / whole)} %`);
      sink.enqueue(value);
    },
  });
  return new Response(counted, { headers: { "Content-Type": "application/wasm" } });
}

function watch(handle) {
  if (!handle.has_panicked()) return setTimeout(watch, 1000, handle);
  fail(`it stopped: ${handle.panic_message()}`);
}

async function start() {
  await wasm_bindgen({ module_or_path: program() });
  say("Loading the recording …");
  const handle = new wasm_bindgen.WebHandle({
    url: [recordingAddress],
    hide_welcome_screen: true,
    enable_history: false,
    notebook: false,
    persist: false, // it opens as the recording says, not as somebody left another one
    theme: "dark",
  });
  await handle.start(canvas);
  say("");
  // The viewer's own field for what is typed: without a name it is nothing to who hears the page.
  for (const field of document.querySelectorAll("input:not([aria-label])")) field.ariaLabel = "Text typed in the viewer";
  canvas.focus();
  watch(handle);
}

if (typeof WebAssembly === "undefined") fail("it has no WebAssembly");
else start().catch((error) => fail(error.message || String(error)));
