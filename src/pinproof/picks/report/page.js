// The page of many picks: arrows at the grasps, the caption and the motion of the chosen pick.
const { marked, motions, markers } = settings;
const captions = document.querySelectorAll("#captions template");
let chosen = -1, trail = null;

// --- arrows: one instance per grasp; what the filter hides is scaled to nothing ---
const shape = new THREE.BufferGeometry();
shape.setAttribute("position", new THREE.BufferAttribute(markers.vertices, 3));
shape.setAttribute("normal", new THREE.BufferAttribute(markers.normals, 3));
shape.setIndex(new THREE.BufferAttribute(markers.triangles, 1));
const look = { color: 0xffffff, side: THREE.DoubleSide };
const arrows = new THREE.InstancedMesh(shape, new THREE.MeshPhongMaterial({ ...look, shininess: 20 }), marked.length);
marked.forEach((_, k) => arrows.setColorAt(k, new THREE.Color().fromArray(markers.rgb, 3 * k)));
// The same once more, faint and through whatever is in front of them.
const faint = new THREE.MeshBasicMaterial({ ...look, transparent: true, opacity: 0.28, depthTest: false });
const hidden = new THREE.InstancedMesh(shape, faint, marked.length);
Object.assign(hidden, { instanceMatrix: arrows.instanceMatrix, instanceColor: arrows.instanceColor });
arrows.frustumCulled = hidden.frustumCulled = false;  // their bounds are those of one arrow at the origin
viewer.scene_tree.find(["grasps"]).set_object(arrows);
viewer.scene_tree.find(["hidden grasps"]).set_object(hidden);
const halo = new THREE.Mesh(new THREE.SphereGeometry(markers.length * 0.3, 24, 16),
  new THREE.MeshBasicMaterial({ color: settings.theme.accent, transparent: true, opacity: 0.35, depthTest: false }));
viewer.scene_tree.find(["halo"]).set_object(halo);

function drawArrows() {
  const m = new THREE.Matrix4(), nothing = new THREE.Matrix4().makeScale(0, 0, 0);
  const larger = new THREE.Matrix4().makeScale(1.5, 1.5, 1.5);
  marked.forEach((row, k) => {
    m.fromArray(markers.poses, 16 * k);
    if (row === chosen) m.multiply(larger);
    arrows.setMatrixAt(k, rows[row].isConnected || row === chosen ? m : nothing);
  });
  arrows.instanceMatrix.needsUpdate = true;
  const place = marked.indexOf(chosen);
  halo.visible = place >= 0;
  if (halo.visible) halo.position.fromArray(markers.poses, 16 * place + 12);
  viewer.set_dirty();
}

// --- the chosen pick ---
function choose(k) {
  chosen = k;
  select([k]);
  byId("chosen").value = String(k);
  byId("caption").replaceChildren(/** @type {any} */ (captions[k]).content.cloneNode(true));
  pose(motions[k]);
  drawArrows();
}

// Back to rest, then the motion, if there is one: meshcat's clips only know what they move.
function pose(motion) {
  const show = (path, value) => viewer.handle_command({ type: "set_property", path, property: "visible", value });
  const showRider = (path, value) => { if (path.startsWith("/riders/")) show(path, value); };  // the scene is always visible
  viewer.animator.clear();
  viewer.animator.pause();
  for (const command of settings.rest) viewer.handle_command(command);
  for (const other of motions) for (const path of Object.keys(other?.riders ?? {})) showRider(path, false);
  show("/open hand", !motion);
  if (trail) { trail.geometry.dispose(); trail.visible = false; trail = null; }
  if (motion) {
    for (const [path, matrix] of Object.entries(motion.riders)) {
      viewer.handle_command({ type: "set_transform", path, matrix });
      showRider(path, true);
    }
    const line = new THREE.BufferGeometry().setAttribute("position", new THREE.BufferAttribute(motion.path, 3));
    trail = new THREE.Line(line, new THREE.LineBasicMaterial({ color: settings.theme.path }));
    viewer.scene_tree.find(["tcp path"]).set_object(trail);
    const animations = motion.tracks.map((track) => ({ ...track }));  // meshcat writes into its argument
    const options = { play: false, repetitions: 1_000_000 };
    if (animations.length) viewer.handle_command({ type: "set_animation", animations, options });
  }
  offer(motion ? motion.duration : 0);
}

function step(by) {
  const shown = [...body.rows].map((row) => Number(row.dataset.row)), place = shown.indexOf(chosen);
  if (shown.length) chooseRow(shown[place < 0 ? 0 : Math.min(Math.max(place + by, 0), shown.length - 1)]);
}
onChoose = choose;
onFilter = drawArrows;
byId("before").addEventListener("click", () => step(-1));
byId("after").addEventListener("click", () => step(1));
byId("chosen").addEventListener("change", (event) => chooseRow(Number(event.target.value)));

// The arrow that a ray hits.
rowAt = (ray) => (marked.length ? marked[ray.intersectObject(arrows)[0]?.instanceId] : null) ?? null;

// The pick of the address, or the first good one, so that there is something to see at once.
drawArrows();
const linked = rowInAddress();
if (rows.length) choose(linked >= 0 ? linked : Math.max(motions.findIndex((motion) => motion), 0));
Object.assign(window.pinproof, { choose, arrows });
Object.defineProperty(window.pinproof, "chosen", { get: () => chosen });
