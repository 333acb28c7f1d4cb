// The light on a receiver in false colour: the wanted outline, the image of the LED, and cross-sections at a point.
import { TABLE, colour, drawing } from "./frames.js";

const MARGIN = 46, STRIP = 58;

export class Picture {
  constructor(canvas, readout) {
    Object.assign(this, { canvas, readout, frame: null, wanted: null, number: 0, stop: 0, at: null, twin: null });
    const place = event => {
      const box = canvas.getBoundingClientRect();
      this.move((event.clientX - box.left - this.left) / this.side.width, (event.clientY - box.top - this.top) / this.side.height);
    };
    canvas.addEventListener("pointermove", event => this.side && place(event));
    canvas.addEventListener("pointerdown", event => this.side && place(event));
    canvas.addEventListener("keydown", event => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (!step || !this.side) return;
      event.preventDefault();
      const [x, y] = this.at ?? [0.5, 0.5], by = event.shiftKey ? 0.1 : 0.01;
      this.move(x + by * step[0], y + by * step[1]);
    });
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  show(frame, wanted) {
    Object.assign(this, { frame, wanted });
    this.draw();
  }

  move(x, y, leads = true) {
    this.at = [Math.min(Math.max(x, 0), 1), Math.min(Math.max(y, 0), 1)];
    if (leads) this.twin?.move(x, y, false);
    this.draw();
  }

  get receiver() {
    return (this.frame ?? this.wanted)?.receivers?.[this.number];
  }

  draw() {
    const { pen, width, height } = drawing(this.canvas), receiver = this.receiver;
    if (!receiver) return;
    const light = this.frame?.arrays[`light${this.number}${receiver.stops ? `_${Math.min(this.stop, receiver.stops.length - 1)}` : ""}`], target = (this.frame ?? this.wanted).arrays[`target${this.number}`];
    const shown = light ?? target, [rows, columns] = shown.shape, largest = Math.max(...shown.values, 1e-30);
    const room = [width - MARGIN - STRIP - 8, height - MARGIN - STRIP];
    const scale = Math.min(room[0] / receiver.width, room[1] / receiver.height);
    this.side = { width: receiver.width * scale, height: receiver.height * scale };
    this.left = MARGIN + (room[0] - this.side.width) / 2;
    this.top = STRIP + (room[1] - this.side.height) / 2;
    this.paint(pen, shown.values, rows, columns, largest, light ? 1 : 0.55);
    if (target) this.outline(pen, target);
    this.axes(pen, receiver);
    const image = this.wanted?.receivers[this.number]?.image;
    if (image && !light) this.circle(pen, image * scale);
    this.sections(pen, shown, light && target, largest, receiver, Boolean(light));
  }

  paint(pen, values, rows, columns, largest, strength) {
    const pixels = new ImageData(columns, rows);
    for (let row = 0; row < rows; row += 1) for (let column = 0; column < columns; column += 1) {
      const level = Math.round(255 * strength * Math.max(0, values[(rows - 1 - row) * columns + column]) / largest);
      const to = 4 * (row * columns + column);
      for (let c = 0; c < 3; c += 1) pixels.data[to + c] = TABLE[3 * level + c];
      pixels.data[to + 3] = 255;
    }
    this.sheet ??= document.createElement("canvas");
    Object.assign(this.sheet, { width: columns, height: rows });
    this.sheet.getContext("2d").putImageData(pixels, 0, 0);
    pen.imageSmoothingEnabled = columns < 200;
    pen.drawImage(this.sheet, this.left, this.top, this.side.width, this.side.height);
  }

  // The line at half of the peak of the target, through the edges of its pixels (marching squares).
  outline(pen, target) {
    const [rows, columns] = target.shape, values = target.values, half = 0.5 * Math.max(...values);
    const x = column => this.left + (column + 0.5) / columns * this.side.width;
    const y = row => this.top + this.side.height - (row + 0.5) / rows * this.side.height;
    pen.beginPath();
    for (let row = 0; row < rows - 1; row += 1) for (let column = 0; column < columns - 1; column += 1) {
      const corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(([a, b]) => [column + a, row + b]), cut = [];
      const level = ([a, b]) => values[b * columns + a] - half;
      corners.forEach((one, k) => {
        const other = corners[(k + 1) % 4], before = level(one), after = level(other);
        if (before < 0 !== after < 0) {
          const part = before / (before - after);
          cut.push([x(one[0] + part * (other[0] - one[0])), y(one[1] + part * (other[1] - one[1]))]);
        }
      });
      for (let k = 0; k + 1 < cut.length; k += 2) { pen.moveTo(...cut[k]); pen.lineTo(...cut[k + 1]); }
    }
    Object.assign(pen, { strokeStyle: "#fff", lineWidth: 1, globalAlpha: 0.85 });
    pen.stroke();
    pen.globalAlpha = 1;
  }

  axes(pen, receiver) {
    const unit = receiver.far ? "°" : receiver.width > 2000 ? "m" : "mm", [ink, left, bottom] = [colour("soft"), this.left, this.top + this.side.height];
    pen.fillStyle = ink;
    const ticks = size => [-0.5, -0.25, 0, 0.25, 0.5].map(share => [share, label(share * size, receiver, unit)]);
    pen.textAlign = "center";
    for (const [share, words] of ticks(receiver.width)) pen.fillText(words, left + (share + 0.5) * this.side.width, bottom + 15);
    pen.fillText(`x (${unit})`, left + this.side.width / 2, bottom + 31);
    pen.textAlign = "right";
    for (const [share, words] of ticks(receiver.height)) pen.fillText(words, left - 5, bottom - (share + 0.5) * this.side.height + 4);
  }

  circle(pen, diameter) {
    pen.beginPath();
    pen.arc(this.left + this.side.width / 2, this.top + this.side.height / 2, diameter / 2, 0, 7);
    Object.assign(pen, { strokeStyle: "#7fe0ff", lineWidth: 1.5 });
    pen.setLineDash([4, 3]);
    pen.stroke();
    pen.setLineDash([]);
  }

  sections(pen, light, target, largest, receiver, lit) {
    const [rows, columns] = light.shape, [x, y] = this.at ?? [0.5, 0.5], { left, top, side } = this;
    const column = Math.min(columns - 1, Math.floor(x * columns)), row = rows - 1 - Math.min(rows - 1, Math.floor(y * rows));
    const right = left + side.width;
    for (const [image, ink, thick] of [[target, colour("soft"), 1], [light, colour("accent"), 1.6]]) if (image) {
      Object.assign(pen, { strokeStyle: ink, lineWidth: thick });
      pen.beginPath();
      for (let k = 0; k < columns; k += 1) pen.lineTo(left + (k + 0.5) / columns * side.width, top - 6 - (STRIP - 14) * Math.min(1, image.values[row * columns + k] / largest));
      pen.stroke();
      pen.beginPath();
      for (let k = 0; k < rows; k += 1) pen.lineTo(right + 6 + (STRIP - 14) * Math.min(1, image.values[k * columns + column] / largest), top + side.height - (k + 0.5) / rows * side.height);
      pen.stroke();
    }
    if (!this.at) {
      this.readout.textContent = lit ? `peak ${short(largest)} ${receiver.unit}; mouse or arrow keys: cross-sections` : "wanted light; the circle is the image of the LED";
      return;
    }
    Object.assign(pen, { strokeStyle: "#ffffffb0", lineWidth: 0.7 });
    pen.beginPath();
    pen.moveTo(left, top + y * side.height); pen.lineTo(right, top + y * side.height);
    pen.moveTo(left + x * side.width, top); pen.lineTo(left + x * side.width, top + side.height);
    pen.stroke();
    const unit = receiver.far ? "°" : "mm", value = light.values[row * columns + column];
    const of = target ? `, wanted ${short(target.values[row * columns + column])} ${receiver.unit}` : "";
    const amount = lit ? `${short(value)} ${receiver.unit}${of}, peak ${short(largest)}` : `${short(100 * value / largest)} % of the wanted peak`;
    this.readout.textContent = `x ${label((x - 0.5) * receiver.width, receiver, unit)} ${unit}, y ${label((0.5 - y) * receiver.height, receiver, unit)} ${unit}: ${amount}`;
  }
}

function label(length, receiver, unit) {
  const value = receiver.far ? 360 / Math.PI * Math.asin(Math.max(-1, Math.min(1, length / 2))) : unit === "m" ? length / 1000 : length;
  return short(value).replace("-", "−");
}

export function short(value) {
  const size = Math.abs(value);
  if (size >= 1e5 || (size > 0 && size < 1e-3)) return value.toExponential(2);
  return String(Number(value.toPrecision(size >= 1000 ? 4 : 3)));
}
