// The script of every page: the 3D view of meshcat, the player, the table and the charts.
/** @type {(id: string) => any} */
const byId = (id) => document.getElementById(id);
/** @type {(selector: string) => any[]} */
const all = (selector) => [...document.querySelectorAll(selector)];
const make = (tag, text, name) => Object.assign(document.createElement(tag), { textContent: text ?? "", className: name ?? "" });
const THREE = MeshCat.THREE;
const pane = byId("meshcat-pane");
const viewer = (() => {
  try {
    return new MeshCat.Viewer(pane);
  } catch (error) {
    pane.textContent = "The 3D view needs WebGL, which is not available or disabled in this browser.";
    pane.classList.add("dark");
    throw error;
  }
})();

// A body may have the name of a property that every object has, such as "constructor".
const nodes = viewer.scene_tree.constructor.prototype, findNode = nodes.find;
nodes.find = function (path) {
  for (const named of [this.children, this.folder.__folders ?? {}]) Object.setPrototypeOf(named, null);
  return findNode.call(this, path);
};

// meshcat uses the size of the window; here it uses the size of its pane.
const resize = viewer.set_3d_pane_size.bind(viewer);
viewer.set_3d_pane_size = () => {
  resize(pane.clientWidth, pane.clientHeight);
  if (!touched) frame();
};

// All arrays are in one binary block; {"$buffer": [type, offset, count]} refers to one of them.
const bytes = Uint8Array.from(atob(byId("buffers").textContent), (c) => c.charCodeAt(0));
const arrays = { Float32Array, Int8Array, Uint16Array, Uint32Array };
const read = (id) => JSON.parse(byId(id).textContent, (key, value) => {
  if (value === null || typeof value !== "object" || !value.$buffer) return value;
  const [type, offset, count] = value.$buffer;
  return new arrays[type](bytes.buffer, offset, count);
});
const settings = read("settings");

// --- camera: three.js is y-up inside meshcat, so (x, y, z) of the robot's root frame is (x, z, -y) here ---
let touched = false, toCamera, right, up;
const onFrame = [];  // functions that are called before each frame
/** @type {(point: number[]) => any} */
const vector = ([x, y, z]) => new THREE.Vector3(x, z, -y);
const points = settings.points.map(vector);
function aim(direction) {
  toCamera = vector(direction).normalize();
  right = new THREE.Vector3(0, 1, 0).cross(toCamera).normalize();
  up = toCamera.clone().cross(right);
}
aim(settings.direction);

// The same closed form as pinproof.viewer.camera.fit, for the current canvas.
function frame() {
  const camera = viewer.camera, aspect = pane.clientWidth / Math.max(1, pane.clientHeight);
  const tangent = Math.tan((settings.fieldOfView * Math.PI) / 360) * (1 - settings.margin);
  const centre = [], depths = [];
  for (const [axis, reach] of [[right, tangent * aspect], [up, tangent]]) {
    let high = -Infinity, low = Infinity;
    for (const p of points) {
      const along = p.dot(axis), depth = p.dot(toCamera);
      high = Math.max(high, along + depth * reach);
      low = Math.min(low, along - depth * reach);
    }
    centre.push((high + low) / 2);
    depths.push((high - low) / (2 * reach));
  }
  const nearness = points.map((p) => p.dot(toCamera)), nearest = Math.max(...nearness);
  const distance = Math.max(...depths, nearest + settings.leastDistance * (nearest - Math.min(...nearness)));
  const middle = nearness.reduce((sum, depth) => sum + depth, 0) / points.length;
  const place = (depth) => new THREE.Vector3()
    .addScaledVector(right, centre[0]).addScaledVector(up, centre[1]).addScaledVector(toCamera, depth);
  camera.fov = settings.fieldOfView;
  camera.near = (distance - middle) / 200;
  camera.far = (distance - middle) * 50;
  camera.position.copy(place(distance));
  viewer.controls.target.copy(place(middle));
  viewer.controls.update();
  viewer.set_dirty();
}

for (const command of read("commands")) viewer.handle_command(command);

const meshesUnder = (path) => {
  const meshes = [];
  viewer.scene_tree.find(path).object.traverse((thing) => { if (thing.isMesh) meshes.push(thing); });
  return meshes;
};

// Textures are applied as soon as they are decoded.
const pictured = Promise.all(read("pictures").map(async ([address, nodes]) => {
  const image = new Image();
  image.src = address;
  try { await image.decode(); } catch { return; }  // keep the plain colour
  const map = new THREE.Texture(image);
  map.wrapS = map.wrapT = THREE.RepeatWrapping;
  map.needsUpdate = true;
  for (const node of nodes) {
    viewer.scene_tree.find(node).object.traverse((thing) => {
      if (thing.isMesh) Object.assign(thing.material, { map, needsUpdate: true });
    });
  }
  viewer.set_dirty();
}));
viewer.gui.domElement.style.display = "none";  // the page has its own controls
viewer.controls.addEventListener("start", () => { touched = true; });
viewer.set_3d_pane_size();

// --- player: it controls meshcat's animator ---
const animator = viewer.animator;
const play = byId("play"), scrub = byId("scrub"), clock = byId("clock");
let duration = 0;
let parameter = /** @type {any} */ (null);  // of a self-motion: the slider shows its value instead of a time

function seek(t) {
  if (animator.actions.length === 0) return;
  animator.play();  // only running actions take a new time
  animator.pause();
  const time = Math.min(Math.max(t, 0), duration);
  animator.seek(time);
  animator.display_progress(time);
}

function fromAddress() {
  const stated = /(?:^#|&)t=([0-9.]+)/.exec(location.hash);
  if (stated && isFinite(Number(stated[1]))) seek(Number(stated[1]));
  return Boolean(stated);
}

// The row of #pick=NAME in the address, -1 without one.
function rowInAddress() {
  const stated = /(?:^#|&)pick=([^&]*)/.exec(location.hash);
  let name = stated?.[1] ?? "";
  try { name = decodeURIComponent(name); } catch { /* the name as it is */ }
  return stated ? (settings.picks ?? []).findIndex((pick) => pick.name === name) : -1;
}

// Show the player for a motion of the given duration, if there is one. The motion starts unless it shall be paused at a
// time (start, or t in the URL), or the user prefers reduced motion. The slider of a joint (varied) is paused at its value.
function offer(seconds, start = null, varied = null) {
  duration = seconds;
  parameter = varied;
  const moving = animator.actions.length > 0;
  byId("player").hidden = !moving;
  if (!moving) return;
  scrub.max = duration;
  if (parameter) {
    scrub.setAttribute("aria-label", parameter.name + " in " + parameter.unit);
    scrub.title = parameter.name;
  }
  if (fromAddress()) return;
  if (parameter) seek(parameter.shown - parameter.first);
  else if (start !== null) seek(start);
  else if (!window.matchMedia("(prefers-reduced-motion: reduce)").matches) animator.play();
}

function toggle() {
  if (animator.playing) animator.pause();
  else animator.play();
}

// Keyboard shortcuts of the page, unless the focused element uses the key.
const STEP = 1 / 30;
window.addEventListener("keydown", (/** @type {any} */ event) => {
  if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target.closest("input:not([type=checkbox]), select, textarea, summary, .scroll")) return;
  if (event.key === "r" || event.key === "R") byId("reset").click();
  if (animator.actions.length === 0) return;
  if (event.key === " " && !event.target.closest("input, button")) toggle();
  else if (event.key === "ArrowLeft") seek(animator.time - STEP);
  else if (event.key === "ArrowRight") seek(animator.time + STEP);
  else return;
  event.preventDefault();
});
play.addEventListener("click", toggle);
byId("speed").addEventListener("change", () => { animator.mixer.timeScale = Number(byId("speed").value); });
scrub.addEventListener("input", () => seek(Number(scrub.value)));
window.addEventListener("hashchange", () => {
  if (rowInAddress() >= 0) onChoose(rowInAddress());
  fromAddress();
});

// --- table: it sorts by every column, and shows the rows with a text and the value of the pressed chip ---
const body = byId("rows"), find = byId("find");
const rows = body ? [...body.rows] : [], heads = body ? all("#list th") : [];
const texts = rows.map((row) => row.textContent.toLowerCase());
let order = [...rows.keys()], onFilter = () => {}, onSelect = () => {};
let onChoose = (/** @type {number} */ _) => {}, rowAt = (/** @type {any} */ _) => /** @type {number | null} */ (null);
rows.forEach((row, index) => { row.dataset.row = index; });

function fillTable() {
  const wanted = find.value.trim().toLowerCase(), chip = all(".chip[aria-pressed=true]")[0];
  const shown = order.filter((k) => texts[k].includes(wanted)
    && (!chip || rows[k].cells[1].lastChild.textContent === chip.dataset.value));
  body.replaceChildren(...shown.map((k) => rows[k]));
  byId("none").hidden = shown.length > 0;
  byId("count").textContent = shown.length + " of " + rows.length + " shown";
  giveTabStop();
  onFilter();
}

function giveTabStop() {  // the table is one stop of the Tab key; arrow keys move inside it
  for (const row of rows) row.tabIndex = -1;
  const stop = body.querySelector("[aria-selected=true]") || body.firstElementChild;
  if (stop) stop.tabIndex = 0;
}

function chooseRow(k) {  // by the reader: the address becomes a link to it
  onChoose(k);
  if (!settings.picks) return;
  try { history.replaceState(null, "", "#pick=" + encodeURIComponent(settings.picks[k].name)); } catch { /* inside a frame */ }
}

function select(chosen) {  // the selected rows; the first one is brought into view
  rows.forEach((row, k) => row.setAttribute("aria-selected", String(chosen.includes(k))));
  onSelect();
  giveTabStop();
  const row = rows[chosen[0]];
  if (!row?.isConnected) return;
  // scrollIntoView would also scroll the page, on a narrow screen away from the picture.
  const list = byId("scroller"), inner = row.getBoundingClientRect(), outer = list.getBoundingClientRect();
  const head = list.querySelector("thead").offsetHeight;  // it covers the first row
  list.scrollTop += Math.min(inner.top - outer.top - head, 0) || Math.max(inner.bottom - outer.bottom, 0);
}

heads.forEach((head, column) => {
  const button = make("button", head.textContent), numeric = head.style.textAlign === "right";
  button.type = "button";
  head.replaceChildren(button);
  button.addEventListener("click", () => {
    const down = head.getAttribute("aria-sort") === "ascending";
    /** @type {any[]} */
    const keys = rows.map((row) => row.cells[column].textContent).map((text) => numeric ? parseFloat(text) : text);
    const empty = (key) => key === "" || Number.isNaN(key);  // missing values come last in either order
    order = [...rows.keys()].sort((a, b) => Number(empty(keys[a])) - Number(empty(keys[b])) || (empty(keys[a]) ? 0 : (down ? -1 : 1)
      * (numeric ? keys[a] - keys[b] : keys[a].localeCompare(keys[b], undefined, { numeric: true }))) || a - b);
    for (const other of heads) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    fillTable();
  });
});
for (const chip of all(".chip")) {
  chip.addEventListener("click", () => {
    const pressed = chip.getAttribute("aria-pressed") === "true";
    for (const each of all(".chip")) each.setAttribute("aria-pressed", String(each === chip && !pressed));
    fillTable();
  });
}
if (body) {
  find.addEventListener("input", fillTable);
  const rowOf = (event) => event.target.closest("tr");
  body.addEventListener("click", (event) => chooseRow(Number(rowOf(event).dataset.row)));
  body.addEventListener("keydown", (event) => {
    const row = rowOf(event);
    const goal = { ArrowDown: row.nextElementSibling, ArrowUp: row.previousElementSibling,
      Home: body.firstElementChild, End: body.lastElementChild, Enter: row, " ": row }[event.key];
    if (!goal) return;
    event.preventDefault();
    chooseRow(Number(goal.dataset.row));
    goal.focus();
  });
  fillTable();
}

// --- charts: a line at the current time, a click seeks; the Gantt chart can be enlarged ---
const plots = all(".plot").map((plot) => {
  plot.addEventListener("click", (event) => {
    const box = plot.getBoundingClientRect();
    seek((event.clientX - box.left) / box.width * duration);
  });
  return plot.appendChild(make("i", "", "now"));
});
for (const panel of all("details.below")) panel.addEventListener("toggle", () => viewer.set_3d_pane_size());
const gantt = byId("gantt"), zoom = byId("zoom");
const bars = all("#gantt [data-start]").map((bar) => [Number(bar.dataset.start), Number(bar.dataset.end), bar.title]);

// From the complete cycle in the visible width to 100 pixels a second; a time at least every 60 pixels.
function enlarge() {
  const least = gantt.parentElement.clientWidth / duration, scale = least * Math.max(100 / least, 1) ** Number(zoom.value);
  const step = [0.1, 0.5, 1, 2, 5, 10, 30, 60, 120, 300, 600].find((seconds) => seconds * scale >= 60) || 1200;
  gantt.style.width = 100 * scale / least + "%";
  gantt.querySelectorAll(".time").forEach((mark) => mark.remove());
  gantt.prepend(...Array.from({ length: Math.ceil(duration / step) }, (_, k) => {
    const mark = make("span", (step < 1 ? (k * step).toFixed(1) : k * step) + " s", "time");
    mark.style.left = 100 * k * step / duration + "%";
    return mark;
  }));
}

// --- what follows the time: the controls, the lines of the charts, the rows of a sequence and the name of the phase ---
let last = null;
function follow() {
  const t = Math.min(animator.time, duration), label = animator.playing ? "Pause" : "Play";
  if (play.textContent !== label) {
    play.textContent = label;
    play.setAttribute("aria-pressed", String(animator.playing));
  }
  if (document.activeElement !== scrub || animator.playing) scrub.value = t;
  const text = parameter ? parameter.name + " = " + (parameter.first + t).toFixed(3) + " " + parameter.unit
    : t.toFixed(2) + " / " + duration.toFixed(2) + " s";
  if (clock.textContent !== text) clock.textContent = text;
  for (const line of plots) line.style.left = 100 * t / Math.max(duration, 1e-9) + "%";
  if (settings.moments && t !== last) {
    const moments = settings.moments;
    let active = [...moments.keys()].filter((k) => t >= moments[k][0] && t < moments[k][1]);
    if (!active.length) active = [Math.max(moments.findLastIndex(([start]) => start <= t), 0)];
    if (active.some((k) => rows[k].getAttribute("aria-selected") !== "true")
      || body.querySelectorAll("[aria-selected=true]").length !== active.length) select(active);
    byId("now").textContent = bars.filter(([start, end]) => t >= start && t < end).map(([, , title]) => title).join("; ");
    const scroll = gantt.parentElement, x = gantt.clientWidth * t / duration - scroll.scrollLeft;
    if (animator.playing && (x < 0 || x > scroll.clientWidth)) scroll.scrollLeft += x - 40;  // keep the line in view
  }
  last = t;
  for (const action of onFrame) action();
  requestAnimationFrame(follow);
}

if (settings.duration !== undefined) offer(settings.duration, settings.start ?? null, settings.parameter ?? null);
if (settings.moments) {  // a sequence: a row is chosen by its time
  onChoose = (k) => { if (settings.moments[k]) seek(settings.moments[k][0]); };  // picks that are left out have no time
  zoom.addEventListener("input", enlarge);
  window.addEventListener("resize", enlarge);
  enlarge();
  if (rowInAddress() >= 0) onChoose(rowInAddress());
}
if (/(?:^#|&)still\b/.test(location.hash)) document.body.classList.add("still");
viewer.set_3d_pane_size();
follow();
// write_png waits for this message, which follows a completely drawn frame.
pictured.then(() => requestAnimationFrame(() => requestAnimationFrame(() => console.info("pinproof: drawn"))));
window.pinproof = { viewer, seek, settings, pictured };
