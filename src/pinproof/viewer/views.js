// The views along the axes and of the tool, turning by keys, the section plane, and the picture on paper.
const VIEWS = { Top: [0, -1e-3, 1], Front: [1, 0, 0], Side: [0, -1, 0] };
const FROM = { Top: "above", Front: "the front, +x", Side: "the side, -y" };
const controls = viewer.controls;
/** @type {{node: string[], matrix: number[]} | null} the tool that the camera follows */
let followed = null;
const viewButtons = [];

function press(button, tool = null) {
  followed = tool;
  viewButtons.forEach((other) => other.setAttribute("aria-pressed", String(other === button)));
}

function lookFrom(button, direction, tool = null) {
  press(button, tool);
  touched = tool !== null;  // the camera is framed again when the size of the page changes, unless it follows a tool
  aim(direction);
  if (!tool) frame();
}

function addView(name, from, direction, tool = null) {
  const button = Object.assign(make("button", name), { type: "button", title: "Look from " + from });
  button.addEventListener("click", () => lookFrom(button, direction, tool));
  viewButtons.push(button);
  byId("views").append(button);
}
for (const [name, direction] of Object.entries(VIEWS)) addView(name, FROM[name], direction);
for (const tool of settings.tools ?? []) {
  addView(("Tool " + tool.name).trim(), "behind the tool, which the view follows", settings.direction, tool);
}
press(null);
byId("reset").addEventListener("click", () => lookFrom(null, settings.direction));
controls.addEventListener("start", () => press(null));

// Behind the tcp and beside its z axis, so that the flange does not hide the tool.
const TOOL_VIEW = [0.5, 0, -0.85];
function followTool() {
  if (!followed) return;
  const link = viewer.scene_tree.find(followed.node).object;
  link.updateWorldMatrix(true, false);
  const tcp = new THREE.Matrix4().fromArray(followed.matrix).premultiply(link.matrixWorld);
  const target = new THREE.Vector3().setFromMatrixPosition(tcp);
  const size = new THREE.Box3().setFromPoints(points).getSize(new THREE.Vector3()).length();
  const eye = new THREE.Vector3(...TOOL_VIEW).transformDirection(tcp).multiplyScalar(0.6 * size).add(target);
  if (eye.distanceTo(viewer.camera.position) < 1e-6 && target.distanceTo(controls.target) < 1e-6) return;
  viewer.camera.position.copy(eye);
  controls.target.copy(target);
  controls.update();
  viewer.set_dirty();
}
onFrame.push(followTool);

// --- keys: shift and an arrow turn the view, plus and minus zoom ---
const TURN = 0.1, ZOOM = 1.1;
window.addEventListener("keydown", (/** @type {any} */ event) => {
  if (event.target.closest("input:not([type=checkbox]), select, textarea") || event.ctrlKey || event.metaKey || event.altKey) return;
  const [turn, rise] = (event.shiftKey && { ArrowLeft: [-TURN, 0], ArrowRight: [TURN, 0], ArrowUp: [0, -TURN], ArrowDown: [0, TURN] }[event.key]) || [0, 0];
  const zoom = { "+": 1 / ZOOM, "=": 1 / ZOOM, "-": ZOOM }[event.key] ?? 1;
  if (!turn && !rise && zoom === 1) return;
  const offset = new THREE.Spherical().setFromVector3(viewer.camera.position.clone().sub(controls.target));
  offset.theta += turn;
  offset.phi = Math.min(Math.max(offset.phi + rise, 1e-3), Math.PI - 1e-3);
  offset.radius *= zoom;
  touched = true;
  press(null);
  viewer.camera.position.setFromSpherical(offset).add(controls.target);
  controls.update();
  viewer.set_dirty();
  event.preventDefault();
  event.stopImmediatePropagation();
}, true);

// --- section: what is beyond the plane is not drawn ---
const section = byId("section"), cut = byId("cut"), plane = new THREE.Plane();
function drawSection() {
  const axis = vector([..."xyz"].map((name) => Number(name === section.value)));
  cut.hidden = !section.value;
  byId("cut-at").textContent = section.value ? section.value + " = " + Number(cut.value).toFixed(3) + " m" : "";
  viewer.renderer.clippingPlanes = section.value ? [plane.set(axis.negate(), Number(cut.value))] : [];
  viewer.set_dirty();
}
section.addEventListener("change", () => {
  const box = new THREE.Box3(), side = "xyz".indexOf(section.value);
  for (const root of ["robot", "scene"]) box.expandByObject(viewer.scene_tree.find([root]).object);
  if (box.isEmpty()) box.setFromPoints(points);
  const [low, high] = [[box.min.x, box.max.x], [-box.max.z, -box.min.z], [box.min.y, box.max.y]][side] ?? [0, 1];
  Object.assign(cut, { min: low, max: high, step: (high - low) / 1000, value: (low + high) / 2 });
  drawSection();
});
cut.addEventListener("input", drawSection);

// --- paper: WebGL is not printed by every browser, a copy of its picture is ---
window.addEventListener("beforeprint", () => {
  viewer.render();
  const canvas = viewer.renderer.domElement, paper = byId("paper");
  Object.assign(paper, { width: canvas.width, height: canvas.height });
  paper.getContext("2d").drawImage(canvas, 0, 0);
});
