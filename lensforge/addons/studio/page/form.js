// A form of the spec, made from its JSON schema: units, ranges, defaults and help of every field, and what is wrong with it.
import { element } from "./frames.js";

const UNIT = / \[([^\]]+)\]$/;

export function toml(value) {
  if (Array.isArray(value)) return `[${value.map(toml).join(", ")}]`;
  if (value && typeof value === "object") return `{ ${Object.entries(value).map(([name, each]) => `${name} = ${toml(each)}`).join(", ")} }`;
  return typeof value === "string" ? JSON.stringify(value) : String(value);
}

const steps = name => name.split(".").map(step => (/^\d+$/.test(step) ? Number(step) : step));

export class Form {
  // needs: lengths that each kind of target or limit must have, without their unit.
  constructor(root, schema, needs, change) {
    Object.assign(this, { root, schema, needs, change, opened: new Set(["source", "lens", "constraints", "target", "receivers"]), shape: null });
    this.inputs = new Map();
    this.builders = new WeakMap(); // of what stands in a section, by its element
  }

  resolved(node) {
    return node?.$ref ? { ...this.schema.$defs[node.$ref.split("/").pop()], ...(node.description && { words: node.description }) } : node ?? {};
  }

  // The kinds of a table by their names; "" for a table without kinds, none for any other value.
  kinds(node) {
    const variants = (node.oneOf ?? node.anyOf ?? [node]).map(each => this.resolved(each));
    if (!variants.every(each => each.type === "object" && each.properties)) return null;
    return new Map(variants.map(each => [each.properties.kind?.const ?? each.properties.kind?.enum?.[0] ?? "", each]));
  }

  show({ tables, values }) {
    const shape = this.outline(tables, this.resolved(this.schema), []);
    Object.assign(this, { tables, values: values ?? this.values }); // of the last spec that held
    if (shape !== this.shape) {
      const focused = document.activeElement?.dataset?.place;
      this.inputs.clear();
      this.root.replaceChildren(...this.fields(this.schema, tables, []));
      this.shape = shape;
      if (focused) this.inputs.get(focused)?.focus();
    }
    for (const [place, input] of this.inputs) if (input !== document.activeElement) this.fill(input, JSON.parse(place));
  }

  // Which tables there are, and of which kind: where this changes, the form is made anew.
  outline(value, _node, place) {
    if (Array.isArray(value)) return `[${value.map((each, k) => this.outline(each, null, [...place, k]))}]`;
    if (!value || typeof value !== "object") return "";
    return `{${Object.entries(value).map(([name, each]) => `${name}${name === "kind" ? each : ""}${this.outline(each, null, [...place, name])}`)}}`;
  }

  at(from, place) {
    return place.reduce((value, step) => value?.[step], from);
  }

  fields(section, value, place) {
    const needed = [], shown = [], more = [], rule = this.rule(section, value, place);
    for (const [name, node] of Object.entries(section.properties)) {
      const used = value?.[name] !== undefined, must = (section.required ?? []).includes(name) || rule?.needed.has(name);
      if (name === "kind" && (node.const || node.enum?.length === 1)) continue;
      if (rule?.unfit(name) && !used) continue;
      (place.length === 0 ? shown : must ? needed : used ? shown : more).push([name, node, must]);
    }
    const made = [...needed, ...shown].map(each => this.field(...each, [...place, each[0]], value?.[each[0]]));
    if (more.length) made.push(this.folded("more fields", [...place, "…"], () => more.map(each => this.field(...each, [...place, each[0]]))));
    return made;
  }

  // Of a target or a limit: the fields that it must have on its receiver, and those that are for another one.
  rule(section, value, place) {
    const kind = section.properties.kind?.const, alone = place.length === 1;
    if (!["target", "receivers", "limits"].includes(place[0]) || !(kind in this.needs)) return null;
    const far = this.isFar(place), [unit, other] = far ? ["deg", "mm"] : ["mm", "deg"], places = ["distance_mm", "receiver_mm", "half_angle_deg"];
    const needed = new Set(this.needs[kind].map(name => `${name}_${unit}`));
    if (alone) for (const name of far ? ["half_angle_deg"] : ["distance_mm", "receiver_mm"]) needed.add(name);
    const twin = name => name.replace(new RegExp(`_${other}$`), `_${unit}`);
    return { needed, unfit: name => (places.includes(name) ? !alone || far && name !== "half_angle_deg" : twin(name) !== name && twin(name) in section.properties) };
  }

  // Whether the receiver of a target or a limit is the far field, on which lengths are in degrees.
  isFar([table, number]) {
    const { target, receivers } = this.tables, list = Array.isArray(receivers) ? receivers : [];
    if (table === "receivers") return list[number]?.kind === "far_field";
    const named = table === "limits" && list.find(each => each.name !== undefined && each.name === this.tables.limits?.[number]?.receiver);
    const receiver = named || (table === "limits" && list[0]);
    return receiver ? receiver.kind === "far_field" : target?.half_angle_deg !== undefined;
  }

  folded(title, place, build, note = "") {
    const key = place.join("."), details = element("details", { open: this.opened.has(key) });
    details.append(element("summary", {}, title, element("span", { className: "note" }, note)));
    details.dataset.section = key;
    this.builders.set(details, build);
    details.addEventListener("toggle", () => {
      this.opened[details.open ? "add" : "delete"](key);
      this.build(details);
    });
    if (details.open) this.build(details);
    return details;
  }

  open(details) {
    details.open = true;
    this.build(details);
  }

  // The fields of a section, once it is open.
  build(details) {
    if (!details.open || details.children.length > 1) return;
    const before = new Set(this.inputs.keys());
    details.append(...this.builders.get(details)());
    for (const [at, input] of this.inputs) if (!before.has(at)) this.fill(input, JSON.parse(at));
  }

  field(name, node, needed, place, value) {
    const kinds = this.kinds(this.resolved(node)), words = node.description ?? "", title = name.replaceAll("_", " ");
    if (kinds) return this.folded(title, place, () => this.table(kinds, this.at(this.tables, place), place), value === undefined ? "default" : String(value.kind ?? ""));
    const items = node.type === "array" ? this.kinds(this.resolved(node.items)) : null;
    const entries = Array.isArray(value) ? value : []; // the line on another value stands below the text
    if (items) return this.folded(title, place, () => this.list(items, entries, place), entries.length ? `${entries.length}` : "none");
    return this.entry(name, node, needed, place, words);
  }

  table(kinds, value, place) {
    const names = [...kinds.keys()], kind = value?.kind ?? (names.includes(this.at(this.values, [...place, "kind"])) ? this.at(this.values, [...place, "kind"]) : names[0]);
    const made = this.fields(kinds.get(kind) ?? kinds.get(names[0]), value, place);
    if (names.length > 1) made.unshift(this.entry("kind", { enum: names, description: kinds.get(kind)?.description ?? "" }, true, [...place, "kind"]));
    return made;
  }

  list(kinds, entries, place) {
    const made = entries.map((value, k) => {
      const remove = element("button", { type: "button", onclick: () => this.change([...place, k], null, false) }, "remove");
      return this.folded(`${place.at(-1)} ${k + 1}`, [...place, k], () => [...this.table(kinds, value, [...place, k]), remove], value.name ?? value.kind ?? "");
    });
    const adds = [...kinds.keys()].map(kind => element("button", { type: "button", onclick: () => {
      this.opened.add([...place, entries.length].join("."));
      this.change([...place, entries.length], kind ? { kind } : {}, true);
    } }, `add ${kind.replaceAll("_", " ") || place.at(-1)}`));
    return [...made, element("div", { className: "adds" }, ...adds)];
  }

  entry(name, node, needed, place, words = node.description ?? "") {
    const id = `f-${place.join("-")}`, unit = words.match(UNIT)?.[1] ?? "", own = this.resolved(node), input = this.input(own, id);
    const label = unit ? name.replace(/_[a-z0-9]+(_per_[a-z0-9]+)?$/, "") : name;
    const range = [["minimum", "at least", 1e-6], ["exclusiveMinimum", "above", 0], ["maximum", "at most", 1e9], ["exclusiveMaximum", "below", 1e9]]
      .filter(([key, , usual]) => own[key] !== undefined && (usual === 1e9 ? own[key] < usual : own[key] > usual)).map(([key, word]) => `${word} ${own[key]}`).join(", ");
    const help = element("p", { className: "help", id: `${id}-help` }, [words.replace(UNIT, ""), range && `${range}.`].filter(Boolean).join(" "));
    input.setAttribute("aria-describedby", `${id}-help ${id}-wrong`);
    Object.assign(input.dataset, { place: JSON.stringify(place), type: own.type ?? (own.enum ? "enum" : "") });
    if (needed) input.setAttribute("aria-required", "true");
    input.addEventListener(input.tagName === "INPUT" && input.type === "text" ? "input" : "change", () => this.entered(input, place));
    this.inputs.set(JSON.stringify(place), input);
    const text = element("label", { htmlFor: id }, label.replaceAll("_", " "), unit && element("span", { className: "unit" }, unit));
    return element("div", { className: "field" }, text, input, help, element("p", { className: "wrong", id: `${id}-wrong` }));
  }

  input(node, id) {
    if (node.type === "boolean") return element("input", { id, type: "checkbox" });
    const words = node.enum ?? (node.const ? [node.const] : null);
    if (!words) return element("input", { id, type: "text", inputMode: node.type === "number" || node.type === "integer" ? "decimal" : "text" });
    return element("select", { id }, element("option", { value: "" }, ""), ...words.map(each => element("option", { value: each }, each)));
  }

  entered(input, place) {
    clearTimeout(this.waiting);
    const value = input.type === "checkbox" ? input.checked : input.value === "" ? null : ["string", "enum"].includes(input.dataset.type) ? input.value : { toml: input.value };
    const typed = input.type === "text";
    this.waiting = setTimeout(() => this.change(place, value, !typed), typed ? 150 : 0);
  }

  fill(input, place) {
    const given = this.at(this.tables, place), whole = this.at(this.values, place), value = given ?? (input.type === "text" ? undefined : whole);
    if (input.type === "checkbox") input.checked = value ?? false;
    else input.value = value === undefined || value === null ? "" : typeof value === "string" ? value : toml(value);
    if (input.type === "text") input.placeholder = whole === undefined || whole === null || typeof whole === "object" && !Array.isArray(whole) ? "" : toml(whole).slice(0, 60);
  }

  // Opens the sections around the field of a dotted name, and gives it the focus; false where there is none.
  reveal(name) {
    const place = JSON.stringify(steps(name));
    const around = section => `${name}.`.startsWith(`${section.replace(/\.…$/, "")}.`);
    while (!this.inputs.get(place)?.offsetParent) {
      const closed = [...this.root.querySelectorAll("details:not([open])")].filter(each => around(each.dataset.section));
      const next = closed.find(each => !each.dataset.section.endsWith("…")) ?? closed[0];
      if (!next) break;
      this.open(next);
    }
    this.inputs.get(place)?.focus();
    return this.inputs.has(place);
  }

  // Each line beside its field; gives those of no field that is seen, with the names of their fields.
  mark(lines) {
    const elsewhere = [];
    for (const each of this.root.querySelectorAll(".wrong")) each.textContent = "";
    for (const [, input] of this.inputs) input.removeAttribute("aria-invalid");
    for (const details of this.root.querySelectorAll("details")) details.classList.remove("bad");
    for (const [name, words] of lines) {
      const place = JSON.stringify(steps(name)), input = this.inputs.get(place);
      if (input) input.setAttribute("aria-invalid", "true");
      if (input?.offsetParent) {
        const said = input.parentElement.querySelector(".wrong");
        said.textContent += `${said.textContent ? "\n" : ""}${words}`;
      } else elsewhere.push([name, words]);
      for (const details of this.root.querySelectorAll("details")) if (`${name}.`.startsWith(`${details.dataset.section}.`)) details.classList.add("bad");
    }
    return elsewhere;
  }
}
