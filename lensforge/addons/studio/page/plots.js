// The section of the lens with rays, and the curves of a search.
import { colour, drawing } from "./frames.js";
import { short } from "./picture.js";

function path(pen, values, place) {
  pen.beginPath();
  for (let k = 0; k < values.length; k += 2) pen.lineTo(...place(values[k], values[k + 1]));
}

export function section(canvas, frame) {
  const { pen, width, height } = drawing(canvas);
  const outlines = Object.entries(frame?.arrays ?? {}).filter(([name]) => name.startsWith("outline")).map(([, each]) => each.values);
  if (!outlines.length) return;
  let [reach, low, high] = [0, 0, 0];
  for (const values of outlines) for (let k = 0; k < values.length; k += 2) {
    reach = Math.max(reach, Math.abs(values[k]));
    [low, high] = [Math.min(low, values[k + 1]), Math.max(high, values[k + 1])];
  }
  const scale = Math.min(width / (2.6 * reach), height / (1.35 * high - low + 0.2 * reach));
  const place = (x, z) => [width / 2 + scale * x, height - 10 + scale * (low - z)];
  const fan = frame.arrays.fan;
  Object.assign(pen, { strokeStyle: colour("ray"), lineWidth: 0.8 });
  if (fan) for (let ray = 0; ray < fan.shape[0]; ray += 1) {
    path(pen, fan.values.subarray(2 * ray * fan.shape[1], 2 * (ray + 1) * fan.shape[1]), place);
    pen.stroke();
  }
  for (const values of outlines) {
    path(pen, values, place);
    pen.closePath();
    Object.assign(pen, { fillStyle: colour("glass"), strokeStyle: colour("ink"), lineWidth: 1.1 });
    pen.fill();
    pen.stroke();
  }
  canvas.nextElementSibling.textContent = `${short(2 * reach)} mm wide, ${short(high)} mm above the LED`;
}

export function curves(canvas, frame) {
  const { pen, width, height } = drawing(canvas), nmse = frame?.arrays.nmse?.values, efficiency = frame?.arrays.efficiency?.values;
  if (!nmse || nmse.length < 2) return;
  const logs = Array.from(nmse, value => Math.log10(Math.max(value, 1e-9))), low = Math.floor(Math.min(...logs)), high = Math.ceil(Math.max(...logs));
  const [left, right, top, bottom] = [38, width - 40, 10, height - 20], x = k => left + (right - left) * k / (nmse.length - 1);
  pen.fillStyle = colour("soft");
  pen.strokeStyle = colour("line");
  for (let power = low; power <= high; power += 1) {
    const y = bottom - (bottom - top) * (power - low) / (high - low);
    pen.beginPath(); pen.moveTo(left, y); pen.lineTo(right, y); pen.stroke();
    pen.textAlign = "right";
    pen.fillText(String(Number((10 ** power).toPrecision(1))), left - 4, y + 4);
  }
  pen.textAlign = "left";
  for (const share of [0, 0.5, 1]) pen.fillText(`${100 * share} %`, right + 4, bottom - (bottom - top) * share + 4);
  const line = (ink, count, y) => {
    Object.assign(pen, { strokeStyle: ink, lineWidth: 1.5 });
    pen.beginPath();
    for (let k = 0; k < count; k += 1) pen.lineTo(x(k), y(k));
    pen.stroke();
  };
  line(colour("second"), efficiency.length, k => bottom - (bottom - top) * efficiency[k]);
  line(colour("accent"), logs.length, k => bottom - (bottom - top) * (logs[k] - low) / (high - low));
  pen.fillStyle = colour("accent");
  pen.fillText("NMSE", left + 4, bottom + 14);
  pen.fillStyle = colour("second");
  pen.fillText("efficiency", left + 48, bottom + 14);
}
