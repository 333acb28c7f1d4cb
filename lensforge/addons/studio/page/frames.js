// Frames as page_frames.py packs them: a head of JSON, and arrays of float32 behind it.
const base = new URL("./", location.href);

export async function frame(place) {
  const response = await fetch(new URL(`frame/${place}`, base));
  if (!response.ok) return null;
  const bytes = await response.arrayBuffer();
  const length = new DataView(bytes).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
  const arrays = {};
  for (const [name, { start, shape }] of Object.entries(head.arrays)) {
    const count = shape.reduce((a, b) => a * b, 1);
    arrays[name] = { shape, values: new Float32Array(bytes, 4 + length + start, count) };
  }
  return { ...head, arrays };
}

export async function get(path) {
  return (await fetch(new URL(path, base))).json();
}

// Posts, and gives what the server answers, or the lines on what is wrong.
export async function post(path, content) {
  const body = content instanceof Blob ? content : JSON.stringify(content ?? {});
  const response = await fetch(new URL(path, base), { method: "POST", body });
  const told = response.headers.get("Content-Type")?.startsWith("application/json");
  return told ? response.json() : { lines: [`refused: ${response.status}`] };
}

export function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

// A canvas in pixels of the screen, and its size in those of the page.
export function sized(canvas) {
  const { clientWidth: width, clientHeight: height } = canvas, ratio = devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  return { width, height, ratio };
}

export function drawing(canvas) {
  const { width, height, ratio } = sized(canvas), pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "11px system-ui, sans-serif";
  return { pen, width, height };
}

export const colour = name => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

// Matplotlib's inferno, by a polynomial of degree 6 for each channel, 0 to 255.
const INFERNO = [[0.0002189403691192265, 0.001651004631001012, -0.01948089843709184],
  [0.1065134194856116, 0.5639564367884091, 3.932712388889277], [11.60249308247187, -3.972853965665698, -15.9423941062914],
  [-41.70399613139459, 17.43639888205313, 44.35414519872813], [77.162935699427, -33.40235894210092, -81.80730925738993],
  [-71.31942824499214, 32.62606426397723, 73.20951985803202], [25.13112622477341, -12.24266895238567, -23.07032500287172]];

export const TABLE = new Uint8ClampedArray(3 * 256);
for (let k = 0; k < 256; k += 1) for (let c = 0; c < 3; c += 1)
  TABLE[3 * k + c] = 255 * INFERNO.reduceRight((sum, row) => sum * (k / 255) + row[c], 0);
