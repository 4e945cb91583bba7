// The bodies of the picture: names on hover, the selected one, measuring, and the colours of verdicts.
const ROOTS = [["robot"], ["scene"], ["open hand"], ...Object.keys(viewer.scene_tree.find(["riders"]).children).map((k) => ["riders", k])];
const bodies = ROOTS.flatMap((path) => Object.values(viewer.scene_tree.find(path).children)).map((node) => node.object);
const isBody = new Set(bodies);
const nameOf = (body) => body.name.replaceAll("\u2215", "/");  // meshcat separates levels by slashes
const bodyOf = (thing) => { while (thing && !isBody.has(thing)) thing = thing.parent; return thing; };
const picks = settings.picks ?? [];
const bodyOfRow = picks.map((pick) => pick.body && viewer.scene_tree.find(pick.body).object);
const choice = byId("body"), mode = byId("measure"), reading = byId("reading"), hover = byId("hover");
const caster = new THREE.Raycaster();
bodies.forEach((body, k) => choice.append(new Option(nameOf(body), String(k))));

/** What is under the pointer: the row of an arrow, or a body and the point on it. */
function under(event) {
  const box = pane.getBoundingClientRect(), meshes = [];
  caster.setFromCamera({ x: ((event.clientX - box.left) / box.width) * 2 - 1, y: 1 - ((event.clientY - box.top) / box.height) * 2 }, viewer.camera);
  const row = rowAt(caster);
  if (row !== null) return { row, name: picks[row].name };
  for (const path of ROOTS) viewer.scene_tree.find(path).object.traverseVisible((thing) => thing.isMesh && meshes.push(thing));
  const cuts = viewer.renderer.clippingPlanes;
  const hit = caster.intersectObjects(meshes).find(({ point }) => cuts.every((each) => each.distanceToPoint(point) >= 0));
  const body = hit && bodyOf(hit.object);
  return body ? { row: null, body, name: nameOf(body), point: hit.point } : null;
}

// --- names on hover, again when the picture moves under the pointer ---
let pointer = null, shownAt = NaN;
pane.addEventListener("pointermove", (event) => { shownAt = NaN; pointer = event.buttons || event.pointerType === "touch" ? null : event; hover.hidden ||= !pointer; });
pane.addEventListener("pointerleave", () => { pointer = null; hover.hidden = true; });
onFrame.push(() => {
  if (!pointer || animator.time === shownAt || (animator.playing && Math.abs(animator.time - shownAt) < 0.2)) return;
  const found = under(pointer), box = pane.getBoundingClientRect();
  shownAt = animator.time;
  hover.hidden = !found;
  hover.textContent = found?.name ?? "";
  const left = Math.min(pointer.clientX - box.left + 14, box.width - hover.offsetWidth - 4);
  Object.assign(hover.style, { left: Math.max(left, 4) + "px", top: Math.min(pointer.clientY - box.top + 16, box.height - hover.offsetHeight - 4) + "px" });
});

// --- the selected body glows, and so do those of the selected rows ---
const meshesOf = (body) => { const found = []; body.traverse((thing) => thing.isMesh && found.push(thing)); return found; };
let selected = null, glowing = [];
function glow() {
  for (const mesh of glowing) mesh.material.emissive.setScalar(0);
  const lit = [selected, ...rows.filter((row) => row.getAttribute("aria-selected") === "true").map((row) => bodyOfRow[Number(row.dataset.row)])];
  glowing = [...new Set(lit)].filter(Boolean).flatMap(meshesOf).filter((mesh) => mesh.material.emissive);
  for (const mesh of glowing) mesh.material.emissive.set(settings.theme.accent).multiplyScalar(0.35);
  viewer.set_dirty();
}
onSelect = glow;

const place = (point) => viewer.scene.worldToLocal(point.clone());  // in the frame of the root link
const numbers = (vector, scale, digits) => vector.toArray().map((value) => (scale * value).toFixed(digits)).join(", ");

function selectBody(body) {
  selected = body;
  choice.value = String(bodies.indexOf(body));
  if (!body) choice.value = "";
  const row = body ? bodyOfRow.indexOf(body) : -1;
  if (row >= 0) chooseRow(row);
  glow();
  if (mode.value === "bodies" && body) mark({ body });
  else if (!mode.value) reading.textContent = body ? `${nameOf(body)}, at (${numbers(place(body.getWorldPosition(new THREE.Vector3())), 1, 3)}) m` : "";
}
choice.addEventListener("change", () => selectBody(bodies[Number(choice.value)] ?? null));

// A click, which a drag is not
let pressed = null;
pane.addEventListener("pointerdown", (event) => { pressed = event.button === 0 ? [event.clientX, event.clientY] : null; });
pane.addEventListener("pointerup", (event) => {
  if (!pressed || Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
  const found = under(event);
  if (mode.value === "points") { if (found?.point) mark({ body: found.body, point: found.body.worldToLocal(found.point) }); return; }
  if (found && found.row !== null) chooseRow(found.row);
  else selectBody(found?.body ?? null);
});

// --- measuring: two points on bodies, or the closest points of two bodies as they are drawn; both move with the bodies ---
let marks = [], measured = null, cost = 0;
const line = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: settings.theme.bad, depthTest: false, transparent: true }));
const dots = new THREE.Points(line.geometry, new THREE.PointsMaterial({ color: settings.theme.bad, size: 8, sizeAttenuation: false, depthTest: false, transparent: true }));
for (const thing of [line, dots]) Object.assign(thing, { renderOrder: 10, frustumCulled: false, visible: false });
viewer.scene.add(line, dots);

function mark(next) {
  marks = marks.length === 1 && (mode.value === "points" || marks[0].body !== next.body) ? [...marks, next] : [next];
  measure();
}

function measure() {
  const begun = performance.now(), [first, second] = marks;
  let ends = marks.filter((own) => own.point).map((own) => { own.body.updateWorldMatrix(true, false); return own.body.localToWorld(own.point.clone()); });
  if (second && mode.value === "bodies") ends = closestPoints(first.body, second.body).points;
  ends = ends.map(place);
  line.geometry.setFromPoints(ends);
  line.visible = dots.visible = ends.length > 0;
  if (ends.length === 2) {
    const gap = ends[1].clone().sub(ends[0]), what = mode.value === "bodies" ? `${nameOf(first.body)} to ${nameOf(second.body)}, as drawn: ` : "";
    reading.textContent = `${what}${(1000 * gap.length()).toFixed(1)} mm (x, y, z: ${numbers(gap, 1000, 1)})`;
  } else if (mode.value) reading.textContent = (first ? nameOf(first.body) + "; select the second " : "Select the first ") + (mode.value === "points" ? "point" : "body");
  measured = animator.time;
  cost = performance.now() - begun;
  viewer.set_dirty();
}
mode.addEventListener("change", () => { marks = []; reading.textContent = ""; measure(); });
onFrame.push(() => { if (marks.length && animator.time !== measured && (cost < 12 || !animator.playing)) measure(); });
window.addEventListener("keydown", (event) => {
  if (event.key !== "Escape") return;
  mode.value = "";
  marks = [];
  measure();
  selectBody(null);
});

// --- the colour of the verdict on the pick of a part ---
const tinted = new Map();
picks.forEach(({ colour }, k) => {  // of several picks of a part, one that fails counts
  if (bodyOfRow[k] && (!tinted.has(bodyOfRow[k]) || colour !== settings.theme.good)) tinted.set(bodyOfRow[k], colour);
});
const tints = [...tinted].flatMap(([body, colour]) => meshesOf(body).map((mesh) => [mesh.material, mesh.material.color.clone(), new THREE.Color(colour)]));
const tint = byId("tint");
function drawTints() {
  for (const [material, own, colour] of tints) material.color.copy(own).lerp(colour, tint.checked ? 0.7 : 0);
  viewer.set_dirty();
}
tint.parentElement.hidden = !tints.length;
tint.addEventListener("change", drawTints);
drawTints();
Object.assign(window.pinproof, { bodies, selectBody, closestPoints });
