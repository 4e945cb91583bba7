// Passes the commands to meshcat's viewer and positions the camera.
const byId = (id) => document.getElementById(id);
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
let touched = false;
const vector = ([x, y, z]) => new MeshCat.THREE.Vector3(x, z, -y);
const toCamera = vector(settings.direction).normalize();
const right = new MeshCat.THREE.Vector3(0, 1, 0).cross(toCamera).normalize();
const up = toCamera.clone().cross(right);
const points = settings.points.map(vector);

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
  const place = (depth) => new MeshCat.THREE.Vector3()
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

// Textures are applied as soon as they are decoded.
const pictured = Promise.all(read("pictures").map(async ([address, nodes]) => {
  const image = new Image();
  image.src = address;
  try { await image.decode(); } catch { return; }  // keep the plain colour
  const map = new MeshCat.THREE.Texture(image);
  map.wrapS = map.wrapT = MeshCat.THREE.RepeatWrapping;
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
byId("reset").addEventListener("click", () => { touched = false; frame(); });
viewer.set_3d_pane_size();

