// A form of the spec, made from its JSON schema: units, ranges, defaults and help of every field, and what is wrong with it.
import { element } from "./frames.js";

const UNIT = / \[([^\]]+)\]$/;

export function toml(value) {
  if (Array.isArray(value)) return `[${value.map(toml).join(", ")}]`;
  if (value && typeof value === "object") return `{ ${Object.entries(value).map(([name, each]) => `${name} = ${toml(each)}`).join(", ")} }`;
  return typeof value === "string" ? JSON.stringify(value) : String(value);
}

export class Form {
  constructor(root, schema, change) {
    Object.assign(this, { root, schema, change, opened: new Set(["source", "lens", "constraints", "target", "receivers"]), shape: null });
    this.inputs = new Map();
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

  show({ tables, values, lines }) {
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
    return this.mark(lines);
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
    const shown = [], more = [];
    for (const [name, node] of Object.entries(section.properties)) {
      const needed = (section.required ?? []).includes(name), used = value?.[name] !== undefined;
      if (name === "kind" && (node.const || node.enum?.length === 1)) continue;
      (needed || used || place.length === 0 ? shown : more).push([name, node, needed]);
    }
    const made = shown.map(each => this.field(...each, [...place, each[0]], value?.[each[0]]));
    if (more.length) made.push(this.folded("more fields", [...place, "…"], () => more.map(each => this.field(...each, [...place, each[0]]))));
    return made;
  }

  folded(title, place, build, note = "") {
    const key = place.join("."), details = element("details", { open: this.opened.has(key) });
    const fill = () => { if (details.open && details.children.length === 1) details.append(...build()); };
    details.append(element("summary", {}, title, element("span", { className: "note" }, note)));
    details.dataset.section = key;
    details.addEventListener("toggle", () => {
      this.opened[details.open ? "add" : "delete"](key);
      const before = this.inputs.size;
      fill();
      if (this.inputs.size > before) for (const [at, input] of this.inputs) if (input !== document.activeElement) this.fill(input, JSON.parse(at));
    });
    fill();
    return details;
  }

  field(name, node, needed, place, value) {
    const kinds = this.kinds(this.resolved(node)), words = node.description ?? "", title = name.replaceAll("_", " ");
    if (kinds) return this.folded(title, place, () => this.table(kinds, this.at(this.tables, place), place), value === undefined ? "default" : value.kind ?? "");
    const items = node.type === "array" ? this.kinds(this.resolved(node.items)) : null;
    if (items) return this.folded(title, place, () => this.list(items, value ?? [], place), value?.length ? `${value.length}` : "none");
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
      const remove = element("button", { type: "button", onclick: () => this.change([...place, k], null) }, "remove");
      return this.folded(`${place.at(-1)} ${k + 1}`, [...place, k], () => [...this.table(kinds, value, [...place, k]), remove], value.name ?? value.kind ?? "");
    });
    const adds = [...kinds.keys()].map(kind => element("button", { type: "button", onclick: () => {
      this.opened.add([...place, entries.length].join("."));
      this.change([...place, entries.length], kind ? { kind } : {});
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
    this.waiting = setTimeout(() => this.change(place, value), input.type === "text" ? 150 : 0);
  }

  fill(input, place) {
    const given = this.at(this.tables, place), whole = this.at(this.values, place), value = given ?? (input.type === "text" ? undefined : whole);
    if (input.type === "checkbox") input.checked = value ?? false;
    else input.value = value === undefined || value === null ? "" : typeof value === "string" ? value : toml(value);
    if (input.type === "text") input.placeholder = whole === undefined || whole === null || typeof whole === "object" && !Array.isArray(whole) ? "" : toml(whole).slice(0, 60);
  }

  // Each line beside its field; gives those of no field that is seen.
  mark(lines) {
    const elsewhere = [];
    for (const each of this.root.querySelectorAll(".wrong")) each.textContent = "";
    for (const [, input] of this.inputs) input.removeAttribute("aria-invalid");
    for (const details of this.root.querySelectorAll("details")) details.classList.remove("bad");
    for (const [name, words] of lines) {
      const place = JSON.stringify(name.split(".").map(step => (/^\d+$/.test(step) ? Number(step) : step))), input = this.inputs.get(place);
      if (input) input.setAttribute("aria-invalid", "true");
      if (input?.offsetParent) {
        const said = input.parentElement.querySelector(".wrong");
        said.textContent += `${said.textContent ? "\n" : ""}${words}`;
      } else elsewhere.push(words);
      for (const details of this.root.querySelectorAll("details")) if (`${name}.`.startsWith(`${details.dataset.section}.`)) details.classList.add("bad");
    }
    return elsewhere;
  }
}
