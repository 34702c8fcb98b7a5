// Three depths of a block diagram in one place: buttons choose, the wheel or a pinch zooms, dragging moves.
"use strict";
const pictures = [...document.querySelectorAll(".depth svg")];
const views = pictures.map((svg) => {
  svg.removeAttribute("width");
  svg.removeAttribute("height");
  const box = svg.viewBox.baseVal;
  return { svg, whole: [box.x, box.y, box.width, box.height], now: [box.x, box.y, box.width, box.height] };
});
const frame = document.getElementById("frame");
const LEAST = 10; // height of the smallest letters that a reader is shown at first [px]
const LETTERS = 11; // the same in a picture's own units
let shown = 0;

function draw(view) {
  view.svg.setAttribute("viewBox", view.now.join(" "));
}

function show(number) {
  shown = number;
  document.querySelectorAll(".depth").forEach((part, i) => { part.hidden = i !== number; });
  document.querySelectorAll("button[data-depth]").forEach((button, i) => { button.ariaPressed = String(i === number); });
  const view = views[number];
  if (!view.seen) legible(view);
  view.seen = true;
}

// Begin in the middle of the top where the whole picture would be too small to read.
function legible(view) {
  const [x, y, width, height] = view.whole;
  const [wide, high] = [frame.clientWidth, frame.clientHeight];
  const scale = Math.min(wide / width, high / height);
  if (scale * LETTERS >= LEAST) return;
  const units = LETTERS / LEAST;
  view.now = [x + (width - wide * units) / 2, y, wide * units, high * units];
  draw(view);
}

function zoom(factor, clientX, clientY) {
  const view = views[shown];
  const at = new DOMPoint(clientX, clientY).matrixTransform(view.svg.getScreenCTM().inverse());
  const [x, y, width, height] = view.now;
  view.now = [at.x - (at.x - x) * factor, at.y - (at.y - y) * factor, width * factor, height * factor];
  draw(view);
}

const fingers = new Map();

function spread() {
  const [a, b] = [...fingers.values()];
  return [Math.hypot(a.x - b.x, a.y - b.y), (a.x + b.x) / 2, (a.y + b.y) / 2];
}

frame.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoom(Math.exp(0.0015 * event.deltaY), event.clientX, event.clientY);
}, { passive: false });
frame.addEventListener("pointerdown", (event) => {
  frame.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
});
frame.addEventListener("pointermove", (event) => {
  const before = fingers.get(event.pointerId);
  if (!before) return;
  if (fingers.size === 2) {
    const [wide] = spread();
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const [wider, x, y] = spread();
    zoom(wide / Math.max(wider, 1), x, y);
    return;
  }
  const view = views[shown];
  const scale = view.svg.getScreenCTM().a;
  view.now[0] -= (event.clientX - before.x) / scale;
  view.now[1] -= (event.clientY - before.y) / scale;
  fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  draw(view);
});
for (const end of ["pointerup", "pointercancel"]) {
  frame.addEventListener(end, (event) => fingers.delete(event.pointerId));
}
document.querySelectorAll("button[data-depth]").forEach((button, i) => button.addEventListener("click", () => show(i)));
document.getElementById("whole").addEventListener("click", () => {
  views[shown].now = [...views[shown].whole];
  draw(views[shown]);
});
show(0);
