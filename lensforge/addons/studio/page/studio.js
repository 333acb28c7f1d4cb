// The page: the spec by form and text, what physics allows, the search, and its results.
import { element, frame, get, post } from "./frames.js";
import { Form } from "./form.js";
import { Picture, short } from "./picture.js";
import { Solid } from "./solid.js";
import { curves, section } from "./plots.js";

const at = id => document.getElementById(id), base = new URL("./", location.href);
const own = new Picture(at("own"), at("own-readout")), beside = new Picture(at("beside"), at("beside-readout"));
const solid = new Solid(at("solid"), at("scale"));
const frames = {}, numbers = {}, notes = {};
let old = []; // names of files of the lens before
[own.twin, beside.twin] = [beside, own];
let state = {}, version = -1, form = null, changes = 0, changed = false;
let lines = [], wrong = []; // on the text; with those on its search

function take(spec) {
  if (spec.version === undefined) return note("change", spec.lines);
  ({ version, lines } = spec);
  const text = spec.text.replaceAll("\r\n", "\n"); // as a browser has it
  if (at("text").value !== text) at("text").value = text;
  form.show(spec);
  at("text").setAttribute("aria-invalid", String(lines.length > 0));
  at("possible").classList.toggle("stale", lines.length > 0);
  note("change", []);
  mark();
}

// What is wrong with the text, and what a search of it would be refused for: beside its field, or below the text.
function mark() {
  const { judged } = state, refused = judged?.version === version ? judged.lines : [];
  wrong = [...lines, ...refused];
  const elsewhere = form.mark(wrong), line = ([name, words]) => {
    const said = elsewhere.some(each => each[1] === words) ? words : `see ${name}`; // once
    const reveal = () => (form.reveal(name) ? mark() : at("text").focus());
    const go = element("button", { type: "button", className: "link", onclick: reveal }, said);
    return element("p", {}, name ? go : said);
  };
  at("text-wrong").replaceChildren(...wrong.map(line));
}

function note(about, lines) {
  notes[about] = lines ?? [];
  at("note").replaceChildren(...Object.entries(notes).flatMap(([name, all]) => all.map(words => element("p", { className: name }, words))));
}

// An answer counts where nothing has been changed since it was asked for.
async function change(content, chosen = false) {
  const mine = changes += 1, answer = await post("spec", content);
  if (mine !== changes) return;
  take(answer);
  const table = content.place?.slice(0, -1).join("."), next = chosen && wrong.find(([name]) => name && `${name}.`.startsWith(table));
  if (next && form.reveal(next[0])) mark(); // what a chosen kind needs
}

async function act(what, content) {
  const answer = await post(`do/${what}`, content);
  note("act", answer.lines);
  return !answer.lines;
}

// What the server says, after every change.
async function hear(now) {
  const before = state;
  state = now;
  if (before.accuracy !== now.accuracy) at("accuracy").value = now.accuracy; // of the search that may go on, too
  if (before.seed !== now.seed) at("seed").value = now.seed;
  const mine = changes;
  if (now.version > version && before.version !== now.version) {
    const spec = await get("spec");
    if (mine === changes) take(spec);
  }
  buttons();
  physics();
  if (form && JSON.stringify(before.judged) !== JSON.stringify(now.judged)) mark();
  note("refused", now.refused);
  note("warned", now.warnings);
  for (const place of ["wanted", "own", "beside"]) if ((now.frames[place] ?? 0) !== (numbers[place] ?? 0) && !frames[`${place} asked`]) {
    frames[`${place} asked`] = true;
    numbers[place] = now.frames[place] ?? 0;
    const before = frames[place];
    frames[place] = now.frames[place] ? await frame(place) : null;
    const text = each => JSON.stringify(each?.receivers) + Object.values(each?.arrays ?? {}).map(own => own.values.join());
    if (place === "own") changed = false;
    else if (place === "wanted" && before) changed ||= text(before) !== text(frames.wanted); // another light than that of the lens
    frames[`${place} asked`] = false;
    show();
    if (numbers[place] !== (state.frames[place] ?? 0)) hear(state);
  }
}

function buttons() {
  const { phase } = state, running = phase === "searching", making = phase === "making";
  at("folder").textContent = `${state.folder}: ${{ idle: "ready", searching: state.stage === "design" ? "searching" : `searched, ${state.stage}`, paused: "paused", making: `making: ${state.stage}` }[phase]}`;
  document.body.dataset.phase = phase;
  at("search").textContent = running ? "Searching" : "Search";
  at("pause").textContent = phase === "paused" ? "Go on" : "Pause";
  at("part").textContent = making ? "Stop" : "Make the part";
  at("search").disabled = running || making;
  at("pause").disabled = !(running || phase === "paused");
  at("enough").disabled = !running;
  at("part").disabled = running || !(making || state.files.includes("design.json"));
  files();
}

function files() {
  const shown = state.files.filter(name => !/\.(json|csv)$/.test(name)), link = name => ({ href: new URL(`file/${name}`, base), target: "_blank", rel: "noopener" });
  at("files").replaceChildren(...shown.map(name => element("li", { className: old.includes(name) ? "old" : "" }, element("a", link(name), old.includes(name) ? `${name}, of the lens before` : name))));
}

function physics() {
  const { bounds, doubts, lens_kinds: kinds } = state, degrees = value => `${short(180 / Math.PI * value)}°`;
  if (bounds?.rows) {
    const blurred = bounds.image_rad > bounds.narrow_rad;
    at("bounds").replaceChildren(...bounds.rows.map(row => {
      const share = row.unit === "", most = share ? 1 : Math.max(row.possible, row.required);
      const meter = element("meter", { max: most, value: Math.min(row.possible, most), low: 0.5 * row.required, high: 0.7 * row.required, optimum: most });
      meter.setAttribute("aria-label", row.words);
      return element("p", { className: "bound" }, element("b", {}, row.name), meter, row.words);
    }), ...(bounds.image_rad ? [element("p", { className: blurred ? "wrong" : "" }, `Image of the LED ${degrees(bounds.image_rad)}, target ${degrees(bounds.narrow_rad)} at its narrowest${blurred ? ": it blurs the target" : ""}`)] : []));
  } else if (bounds) at("bounds").replaceChildren(element("p", {}, bounds.problem));
  const rows = [...(doubts?.warnings ?? []), doubts?.problem, kinds?.problem].filter(Boolean).map(words => element("li", {}, words));
  const kind = form?.values?.lens?.kind ?? form?.tables?.lens?.kind;
  for (const each of kinds?.options ?? []) {
    const used = each.kind === kind, use = element("button", { type: "button", disabled: used, onclick: () => change({ place: ["lens", "kind"], value: each.kind }) }, used ? "used" : "use");
    rows.push(element("li", {}, `${each.title}: at most ${short(100 * each.possible)} %${each.kind === kinds.advised ? ", suits this light" : ""} `, use));
  }
  if (rows.length) at("advice").replaceChildren(...rows);
}

function show() {
  const lens = frames.own, lit = lens?.receivers?.length && !changed ? lens : null, receivers = (lit ?? frames.wanted)?.receivers ?? [];
  at("receiver").hidden = receivers.length < 2;
  if (at("receiver").length !== receivers.length) at("receiver").replaceChildren(...receivers.map((each, k) => element("option", { value: k }, each.name)));
  own.number = beside.number = Math.min(Number(at("receiver").value) || 0, Math.max(0, receivers.length - 1));
  const stops = receivers[own.number]?.stops;
  at("travel").hidden = !stops;
  if (stops) {
    at("stop").max = stops.length - 1;
    own.stop = beside.stop = at("stop").valueAsNumber;
    at("stop-words").textContent = stops[own.stop];
    at("stop").setAttribute("aria-valuetext", stops[own.stop]);
  }
  own.show(lit, frames.wanted);
  at("beside-figure").hidden = !frames.beside;
  if (frames.beside) {
    at("beside-name").textContent = `Light of ${frames.beside.folder}`;
    at("others").value = frames.beside.folder;
    beside.show(frames.beside, null);
  }
  if (!lens) return;
  at("own-name").textContent = changed ? "Light that is wanted now" : lens.name ? `Light of ${lens.name}` : "Light, as it is searched";
  at("result").textContent = lens.facts && !changed ? "Result" : "Result of the lens before";
  solid.show(lens);
  section(at("section"), lens);
  curves(at("curves"), lens);
  if (lens.kind === "step") at("progress").textContent = `level ${lens.level + 1}, step ${lens.step} of ${lens.steps}, ${short(lens.seconds)} s; NMSE ${short(lens.arrays.nmse.values.at(-1))}, efficiency ${short(100 * lens.arrays.efficiency.values.at(-1))} %`;
  if (lens.facts) {
    const rows = lens.facts.map(([label, words, judged]) => {
      const other = frames.beside?.facts?.find(each => each[0] === label);
      return element("tr", { className: judged }, element("th", { scope: "row" }, label), ...[words, ...(frames.beside ? [other?.[1] ?? ""] : [])].map((each, _, all) => element("td", {}, all.length > 1 ? each.split(";")[0] : each)));
    });
    const head = frames.beside ? [element("tr", {}, element("td"), ...["this", frames.beside.folder].map(name => element("th", { scope: "col" }, name)))] : [];
    at("facts").replaceChildren(element("p", {}, lens.sentence), ...lens.verdicts.map(verdict), element("table", {}, ...head, ...rows));
    at("progress").textContent = `${lens.arrays.nmse.values.length} steps`;
    ({ old } = lens);
    files();
  }
}

// A verdict that does not pass: its reasons, and the button that cures it.
function verdict({ name, word, reasons, cure }) {
  const go = () => (cure.change ? change(cure.change, true) : cure.do === "search" ? search(cure.content) : act(cure.do, cure.content));
  const button = cure ? [element("button", { type: "button", className: "cure", onclick: go }, cure.words)] : [];
  const rows = element("ul", {}, ...reasons.map(words => element("li", {}, words)));
  return element("div", { className: `verdict ${word}` }, element("b", {}, `${name}: ${word}`), rows, ...button);
}

// Before it replaces a finished lens a search is confirmed; its settings stand beside the button.
function search(settings = {}) {
  if (settings.accuracy) at("accuracy").value = settings.accuracy;
  const replaced = `${state.folder} holds a finished lens. Search replaces it and its light; its other files stay as those of the lens before, until you make the part. Search?`;
  if (state.asks && !confirm(replaced)) return false;
  return act("search", { accuracy: at("accuracy").value, seed: Number(at("seed").value), ...settings });
}

async function drop(file) {
  at("dropped").textContent = `${file.name}: read …`;
  const found = await post(`dropped/${encodeURIComponent(file.name)}`, file);
  if (found.lines) return at("dropped").replaceChildren(...found.lines.map(words => element("p", { className: "wrong" }, words)));
  const uses = found.fits.map(as => element("button", { type: "button", onclick: () => change({ use: found.name, as }) }, `use as ${as}`));
  at("dropped").replaceChildren(element("p", {}, found.words), element("img", { src: new URL(`dropped/${found.plot}`, base), alt: `Plot of ${found.name}` }), ...uses);
}

async function begin() {
  const { schema, examples, needs } = await get("schema");
  form = new Form(at("form"), schema, needs, (place, value, chosen) => change({ place, value }, chosen));
  for (const [name, words] of Object.entries(examples)) at("examples").append(element("option", { value: name }, `${name}: ${words}`.slice(0, 90)));
  take(await get("spec"));
  for (const name of await get("others")) at("others").append(element("option", { value: name }, name));
  at("form").addEventListener("submit", event => event.preventDefault());
  at("examples").addEventListener("change", event => event.target.value && change({ example: event.target.value }));
  at("search").addEventListener("click", () => search());
  at("pause").addEventListener("click", () => act(state.phase === "paused" ? "go_on" : "pause"));
  at("enough").addEventListener("click", () => act("enough"));
  at("part").addEventListener("click", () => act(state.phase === "making" ? "stop" : "part"));
  at("save").addEventListener("click", async () => { at("saved").textContent = (await act("save")) ? `saved to ${state.saved}` : ""; });
  at("figure").addEventListener("change", () => act("figure", { name: at("figure").value }));
  at("others").addEventListener("change", event => act("beside", { name: event.target.value }));
  at("receiver").addEventListener("change", show);
  at("stop").addEventListener("input", show);
  for (const name of ["side", "rays"]) at(name).addEventListener("change", () => { solid.inner = at("side").checked; solid.rays = at("rays").checked; solid.draw(); });
  let waiting;
  at("text").addEventListener("input", () => { changes += 1; at("saved").textContent = ""; clearTimeout(waiting); waiting = setTimeout(() => change({ text: at("text").value }), 150); });
  at("drop").addEventListener("click", event => event.target !== at("choose") && at("choose").click());
  at("drop").addEventListener("keydown", event => (event.key === "Enter" || event.key === " ") && (event.preventDefault(), at("choose").click()));
  at("choose").addEventListener("change", event => event.target.files[0] && drop(event.target.files[0]));
  addEventListener("dragover", event => event.preventDefault());
  addEventListener("drop", event => { event.preventDefault(); if (event.dataTransfer.files[0]) drop(event.dataTransfer.files[0]); });
  for (const [canvas, draw] of [["section", section], ["curves", curves]]) new ResizeObserver(() => frames.own && draw(at(canvas), frames.own)).observe(at(canvas));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
  const events = new EventSource(new URL("events", base));
  const lost = () => { document.body.dataset.phase = "ended"; note("refused", ["The studio has ended: what is saved is in its folder, and `lensforge studio` opens it again."]); };
  events.addEventListener("message", event => hear(JSON.parse(event.data)));
  events.addEventListener("end", () => { events.close(); lost(); });
  events.addEventListener("error", lost);
  document.body.dataset.ready = "true";
}

addEventListener("unhandledrejection", event => note("broken", [`internal error of this page: ${event.reason}; reload it`]));
begin();
