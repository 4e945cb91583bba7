// The page of a sequence: the chart and the table follow the time of the player, and a click on either sets it.
offer(settings.duration);

// A bar is [phase, start, seconds] in a lane of its phase, or [phase, start, seconds, arm, pick] in a lane of its arm.
const several = settings.arms, LANE = several ? 28 : 16, HEAD = 20;
const laneOf = (bar) => several ? bar[3] : bar[0];
const canvas = byId("gantt"), scroll = byId("scroll"), zoom = byId("zoom"), list = byId("rows");
const rows = settings.rows;
const bars = [...rows.flatMap((row) => row.phases), ...settings.closing];
const lanes = settings.lanes.filter((name) => bars.some((bar) => laneOf(bar) === name));
const phases = Object.keys(settings.colours).filter((name) => bars.some((bar) => bar[0] === name));

byId("phases").append(...phases.map((name) => {
  const item = document.createElement("li"), swatch = document.createElement("span");
  swatch.className = "swatch";
  swatch.style.background = settings.colours[name];
  item.append(swatch, name);
  return item;
}));

list.append(...rows.map((row, index) => {
  const line = document.createElement("tr");
  line.tabIndex = 0;
  const cells = [index + 1, row.name, row.start.toFixed(2) + " s", row.duration.toFixed(2) + " s", row.clearance, row.limit];
  line.append(...cells.map((text, column) => {
    const cell = document.createElement("td");
    cell.textContent = text;
    if (column !== 1 && column !== 5) cell.className = "number";
    return cell;
  }));
  const go = () => seek(row.start);
  line.addEventListener("click", go);
  line.addEventListener("keydown", (event) => {
    if (event.key !== "Enter") return;
    event.preventDefault();
    go();
  });
  return line;
}));
list.append(...settings.left_out.map((pick) => {
  const line = document.createElement("tr");
  line.className = "left-out";
  line.append(...["", pick.name, "left out", "", "", pick.reason].map((text) => {
    const cell = document.createElement("td");
    cell.textContent = text;
    return cell;
  }));
  return line;
}));

// Seconds per pixel: from the complete cycle in the visible width to 100 pixels a second.
function scale() {
  const whole = Math.max(scroll.clientWidth, 1) / Math.max(settings.duration, 1e-9);
  return whole * Math.pow(Math.max(100 / whole, 1), Number(zoom.value));
}

function step(perSecond) {
  return [0.1, 0.5, 1, 2, 5, 10, 30, 60, 120, 300, 600].find((seconds) => seconds * perSecond >= 60) || 1200;
}

// A canvas has a largest size, so only the visible part is drawn, on a canvas of the visible width.
function draw() {
  const k = scale(), ratio = window.devicePixelRatio || 1, width = scroll.clientWidth;
  const height = HEAD + LANE * lanes.length + 4, total = Math.max(width, Math.floor(settings.duration * k));
  canvas.style.width = width + "px";
  canvas.style.height = height + "px";
  canvas.style.position = "sticky";
  canvas.style.left = "0";
  spacer.style.width = total + "px";
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  const at = scroll.scrollLeft, pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "11px system-ui, sans-serif";
  pen.fillStyle = settings.theme.muted;
  const every = step(k);
  for (let t = Math.ceil(at / k / every) * every; t * k - at < width; t += every) {
    const x = t * k - at;
    pen.fillStyle = settings.theme["faint-line"];
    pen.fillRect(x, HEAD - 5, 1, height);
    pen.fillStyle = settings.theme.muted;
    pen.fillText((every < 1 ? t.toFixed(1) : String(Math.round(t))) + " s", x + 3, 12);
  }
  for (const bar of bars) {
    const [name, start, seconds] = bar;
    const x = start * k - at, wide = Math.max(seconds * k, 0.75);
    if (x > width || x + wide < 0) continue;
    pen.fillStyle = settings.colours[name];
    pen.fillRect(x, HEAD + LANE * lanes.indexOf(laneOf(bar)) + 2, wide, LANE - 4);
  }
  if (several) lanes.forEach((name, lane) => {
    pen.fillStyle = settings.theme.veil;
    pen.fillRect(0, HEAD + LANE * lane + 6, pen.measureText(name).width + 10, LANE - 12);
    pen.fillStyle = settings.theme.ink;
    pen.fillText(name, 5, HEAD + LANE * lane + LANE / 2 + 4);
  });
  pen.fillStyle = settings.theme.bad;
  pen.fillRect(Math.min(animator.time, settings.duration) * k - at - 1, 0, 2, height);
}

const spacer = document.createElement("div");
spacer.style.height = "1px";
scroll.append(spacer);
scroll.addEventListener("click", (event) => {
  seek((event.clientX - scroll.getBoundingClientRect().left + scroll.scrollLeft) / scale());
});
scroll.addEventListener("keydown", (event) => {
  if (event.key === "ArrowLeft" || event.key === "ArrowRight") event.stopPropagation();
});
byId("reset").addEventListener("click", () => { touched = false; frame(); });

let selected = [], last = -1;
function follow() {
  const t = Math.min(animator.time, settings.duration);
  let active = [...rows.keys()].filter((index) => t >= rows[index].start && t < rows[index].start + rows[index].duration);
  if (!active.length) active = [Math.max(rows.findLastIndex((row) => row.start <= t), 0)];
  if (active.join() !== selected.join()) {
    selected.forEach((index) => list.children[index].removeAttribute("aria-selected"));
    selected = active;
    active.forEach((index) => list.children[index].setAttribute("aria-selected", "true"));
    reveal(list.children[active[0]], byId("scroller"));
  }
  const now = bars.filter(([, start, seconds]) => t >= start && t < start + seconds);
  now.sort((a, b) => lanes.indexOf(laneOf(a)) - lanes.indexOf(laneOf(b)));
  const text = several
    ? now.map(([phase, , , arm, pick]) => arm + ": " + [pick, phase].filter(Boolean).join(", ")).join("; ")
    : rows[active[0]].name + (now.length ? ", " + now[0][0] : "");
  if (byId("now").textContent !== text) byId("now").textContent = text;
  if (animator.playing && t !== last) {  // keep the cursor in view
    const x = t * scale() - scroll.scrollLeft;
    if (x < 0 || x > scroll.clientWidth) scroll.scrollLeft = t * scale() - 40;
  }
  last = t;
  draw();
  requestAnimationFrame(follow);
}
viewer.set_3d_pane_size();
follow();
pictured.then(() => requestAnimationFrame(() => requestAnimationFrame(() => console.info("pinproof: drawn"))));
window.pinproof = { viewer, seek, settings, pictured, scale, ready: true };
