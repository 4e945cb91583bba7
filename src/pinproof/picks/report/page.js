// The page of many picks: a table, arrows at the grasps, and the motion of the pick that is chosen.
const THREE = MeshCat.THREE;
const { entries, kinds, marked, motions } = settings;
const make = (tag, text, name) => {
  const element = document.createElement(tag);
  if (text !== undefined) element.textContent = text;
  if (name) element.className = name;
  return element;
};
let chosen = -1, verdict = "", order = entries.map((_, k) => k), sorted = { key: "", down: false };

// --- arrows: one instance a grasp; what the filter hides is shrunk to nothing ---
const arrows = makeArrows(settings.markers);
const placeOf = new Map(marked.map((row, k) => [row, k]));
const halo = new THREE.Mesh(
  new THREE.SphereGeometry(settings.markers.length * 0.3, 24, 16),
  new THREE.MeshBasicMaterial({ color: 0x0b5cad, transparent: true, opacity: 0.35, depthTest: false }));
halo.visible = false;
viewer.scene_tree.find(["halo"]).set_object(halo);
let trail = null;

function makeArrows(m) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(m.vertices, 3));
  geometry.setAttribute("normal", new THREE.BufferAttribute(m.normals, 3));
  geometry.setIndex(new THREE.BufferAttribute(m.triangles, 1));
  const look = new THREE.MeshPhongMaterial({ color: 0xffffff, shininess: 20, side: THREE.DoubleSide });
  const mesh = new THREE.InstancedMesh(geometry, look, marked.length);
  const colour = new THREE.Color();
  for (let k = 0; k < marked.length; k++) mesh.setColorAt(k, colour.fromArray(m.rgb, 3 * k));
  mesh.frustumCulled = false;  // its bounds are those of one arrow at the origin
  viewer.scene_tree.find(["grasps"]).set_object(mesh);
  // The same once more, faint and through whatever lies before them.
  const faint = { color: 0xffffff, transparent: true, opacity: 0.28, depthTest: false, side: THREE.DoubleSide };
  const ghosts = new THREE.InstancedMesh(geometry, new THREE.MeshBasicMaterial(faint), marked.length);
  ghosts.instanceMatrix = mesh.instanceMatrix;
  ghosts.instanceColor = mesh.instanceColor;
  ghosts.frustumCulled = false;
  viewer.scene_tree.find(["hidden grasps"]).set_object(ghosts);
  return mesh;
}

function drawArrows(visible) {
  const m = new THREE.Matrix4(), nothing = new THREE.Matrix4().makeScale(0, 0, 0);
  const larger = new THREE.Matrix4().makeScale(1.5, 1.5, 1.5);
  for (let k = 0; k < marked.length; k++) {
    m.fromArray(settings.markers.poses, 16 * k);
    if (marked[k] === chosen) m.multiply(larger);
    arrows.setMatrixAt(k, visible.has(marked[k]) || marked[k] === chosen ? m : nothing);
  }
  arrows.instanceMatrix.needsUpdate = true;
  viewer.set_dirty();
}

// --- table ---
const body = byId("rows"), find = byId("find");
const rows = entries.map((entry, k) => {
  const row = make("tr"), state = make("td"), swatch = make("span", "", "swatch"), why = make("td", entry.reason);
  swatch.style.background = kinds[entry.verdict] || settings.theme.muted;
  state.append(swatch, entry.verdict);
  if (entry.remedy) why.append(make("span", "Suggestion: " + entry.remedy, "try"));
  const seconds = entry.duration === null || entry.duration === undefined ? "" : entry.duration.toFixed(2) + " s";
  row.append(make("td", entry.name), state, make("td", entry.failed), make("td", entry.clearanceText, "number"),
    make("td", seconds, "number"), why);
  row.dataset.row = k;
  row.tabIndex = -1;
  row.setAttribute("aria-selected", "false");
  return row;
});
const words = entries.map((e) => [e.name, e.verdict, e.failed, e.reason, e.remedy].join("\n").toLowerCase());

function fillTable() {
  const wanted = find.value.trim().toLowerCase();
  const shown = order.filter((k) => (!verdict || entries[k].verdict === verdict) && words[k].includes(wanted));
  body.replaceChildren(...shown.map((k) => rows[k]));
  byId("none").hidden = shown.length > 0;
  byId("count").textContent = shown.length + " of " + entries.length + " shown";
  drawArrows(new Set(shown));
  giveTabStop();
}

function giveTabStop() {  // the table is one stop of the Tab key; arrow keys go on inside
  for (const row of rows) row.tabIndex = -1;
  const stop = chosen >= 0 && rows[chosen].isConnected ? rows[chosen] : body.firstElementChild;
  if (stop) stop.tabIndex = 0;
}

function sortBy(key) {
  sorted = { key, down: sorted.key === key && !sorted.down };
  const turn = sorted.down ? -1 : 1, empty = (v) => v === null || v === undefined || v === "";
  order = entries.map((_, k) => k).sort((a, b) => {
    const x = entries[a][key], y = entries[b][key];
    if (empty(x) || empty(y)) return empty(x) - empty(y) || a - b;  // values that are missing come last in either order
    return turn * (typeof x === "number" ? x - y : x.localeCompare(y, undefined, { numeric: true })) || a - b;
  });
  for (const head of document.querySelectorAll("th")) {
    if (head.dataset.key === key) head.setAttribute("aria-sort", sorted.down ? "descending" : "ascending");
    else head.removeAttribute("aria-sort");
  }
  fillTable();
}

// --- the chosen pick ---
function choose(k, { scroll = true } = {}) {
  if (chosen >= 0) rows[chosen].setAttribute("aria-selected", "false");
  chosen = k;
  const entry = entries[k], motion = motions[k];
  rows[k].setAttribute("aria-selected", "true");
  giveTabStop();
  if (scroll && rows[k].isConnected) reveal(rows[k], byId("scroller"));
  byId("chosen").value = String(k);
  caption(entry);
  pose(motion);
  const at = placeOf.get(k);
  halo.visible = at !== undefined;
  if (at !== undefined) halo.position.fromArray(settings.markers.poses, 16 * at + 12);
  drawArrows(new Set([...body.children].map((row) => Number(row.dataset.row))));
}

function caption(entry) {
  const headline = byId("verdict");
  headline.textContent = entry.headline + (entry.failed ? " at " + entry.failed : "");
  headline.className = "verdict " + entry.tone;
  byId("reason").textContent = entry.said;
  byId("remedy").hidden = !entry.remedy;
  byId("remedy").textContent = "Suggestion: " + entry.remedy;
  byId("figures").replaceChildren(...entry.figures.map(([name, value]) => {
    const pair = make("div");
    pair.append(make("dt", name), make("dd", value));
    return pair;
  }));
  byId("motions").replaceChildren(...(entry.motions.length > 1 ? entry.motions : []).map((cells) => {
    const line = make("li");
    line.append(...cells.map((text) => make("span", text)));
    return line;
  }));
  const refuted = byId("refuted");
  refuted.hidden = entry.refuted.length === 0;
  refuted.firstElementChild.textContent = entry.refuted.length + " refuted configurations";
  refuted.lastElementChild.replaceChildren(...entry.refuted.map((text) => make("li", text)));
  byId("stages").replaceChildren(...entry.stages.map(([stage, ok, message]) => {
    const line = make("li", undefined, ok ? "" : "no");
    line.append(make("span", ok ? "\u2713" : "\u2717"), make("span", stage), make("span", message));
    return line;
  }));
}

// Back to rest, then the motion, if there is one: meshcat's clips only know what they move.
function pose(motion) {
  viewer.animator.clear();
  viewer.animator.pause();
  for (const command of settings.rest) viewer.handle_command(command);
  for (const other of motions) for (const path of Object.keys(other ? other.riders : {})) show_(path, false);
  viewer.handle_command({ type: "set_property", path: "/open hand", property: "visible", value: !motion });
  if (trail) { trail.geometry.dispose(); trail.visible = false; trail = null; }
  if (motion) {
    for (const [path, matrix] of Object.entries(motion.riders)) {
      viewer.handle_command({ type: "set_transform", path, matrix });
      show_(path, true);
    }
    const geometry = new THREE.BufferGeometry().setAttribute("position", new THREE.BufferAttribute(motion.path, 3));
    trail = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: 0xd9600a }));
    viewer.scene_tree.find(["tcp path"]).set_object(trail);
    const animations = motion.tracks.map((track) => ({ ...track }));  // meshcat writes into what it is given
    const options = { play: false, repetitions: 1_000_000 };
    if (animations.length) viewer.handle_command({ type: "set_animation", animations, options });
  }
  offer(motion ? motion.duration : 0);
  viewer.set_dirty();
}

function show_(path, visible) {  // obstacles of the scene are always there to see
  if (path.startsWith("/riders/")) viewer.handle_command({ type: "set_property", path, property: "visible", value: visible });
}

function step(by) {
  const seen = [...body.children].map((row) => Number(row.dataset.row));
  if (!seen.length) return;
  const at = seen.indexOf(chosen);
  choose(seen[at < 0 ? 0 : Math.min(Math.max(at + by, 0), seen.length - 1)]);
}

// --- hands ---
for (const head of document.querySelectorAll("th")) {
  head.firstElementChild.addEventListener("click", () => sortBy(head.dataset.key));
}
for (const chip of document.querySelectorAll(".chip")) {
  chip.addEventListener("click", () => {
    verdict = verdict === chip.dataset.verdict ? "" : chip.dataset.verdict;
    for (const c of document.querySelectorAll(".chip")) {
      c.setAttribute("aria-pressed", String(c.dataset.verdict === verdict));
    }
    fillTable();
  });
}
find.addEventListener("input", fillTable);
body.addEventListener("click", (event) => {
  const row = event.target.closest("tr");
  if (row) choose(Number(row.dataset.row), { scroll: false });
});
body.addEventListener("keydown", (event) => {
  const row = event.target.closest("tr");
  const goal = { ArrowDown: row?.nextElementSibling, ArrowUp: row?.previousElementSibling,
    Home: body.firstElementChild, End: body.lastElementChild, Enter: row, " ": row }[event.key];
  if (!goal) return;
  event.preventDefault();
  choose(Number(goal.dataset.row));
  goal.focus();
});
byId("before").addEventListener("click", () => step(-1));
byId("after").addEventListener("click", () => step(1));
byId("chosen").append(...entries.map((entry, k) => {
  const option = make("option", entry.name + " (" + entry.verdict + ")");
  option.value = String(k);
  return option;
}));
byId("chosen").addEventListener("change", (event) => choose(Number(event.target.value)));

// A click on an arrow, which a drag is not.
let pressed = null;
pane.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; });
pane.addEventListener("pointerup", (event) => {
  if (!pressed || Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
  const box = pane.getBoundingClientRect(), caster = new THREE.Raycaster();
  const x = ((event.clientX - box.left) / box.width) * 2 - 1, y = 1 - ((event.clientY - box.top) / box.height) * 2;
  caster.setFromCamera({ x, y }, viewer.camera);
  const hit = marked.length ? caster.intersectObject(arrows)[0] : undefined;
  if (hit) choose(marked[hit.instanceId]);
});

fillTable();
byId("card").hidden = entries.length === 0;
// The first good pick, so that there is something to see at once.
const first = entries.findIndex((_, k) => motions[k]);
if (entries.length) choose(first >= 0 ? first : 0);
window.pinproof = { viewer, seek, settings, choose, arrows, get chosen() { return chosen; }, ready: true };
