// The page of one motion or configuration: copies of links, frames, contacts, the switches of the layers, and live views.
// --- ghosts and the swept tool ---
settings.copies.forEach((copy, number) => {
  const group = new THREE.Group(), colour = new THREE.Color();
  for (let k = 0; k < copy.count; k++) {
    // Coincident surfaces would flicker; each copy gets a larger depth offset than the one before.
    const back = { polygonOffset: true, polygonOffsetFactor: 0.4 * (k + 1), polygonOffsetUnits: 2 * (k + 1) };
    const one = new THREE.Group();
    one.matrix.fromArray(copy.matrices, 16 * k);
    one.matrixAutoUpdate = false;
    for (const mesh of meshesUnder(copy.of)) {
      // The first pass writes only the depth buffer, so that only the outer surface of a copy is visible.
      const shell = new THREE.MeshBasicMaterial({ colorWrite: false, side: THREE.DoubleSide, ...back });
      const look = Object.assign(mesh.material.clone(), { transparent: true, opacity: copy.opacity, depthWrite: false, ...back });
      if (copy.rgb) look.color.copy(colour.fromArray(copy.rgb, 3 * k));
      [shell, look].forEach((material, pass) => {
        const part = new THREE.Mesh(mesh.geometry, material);
        part.renderOrder = 1 + pass;
        one.add(part);
      });
    }
    group.add(one);
  }
  viewer.scene_tree.find([copy.into, String(number)]).set_object(group);
});

// --- frames: red x, green y, blue z, and the name ---
for (const [node, name, below] of settings.frames.names) {
  const size = settings.frames.length, group = new THREE.Group();
  settings.theme.axes.forEach((color, axis) => {
    const rod = new THREE.Mesh(new THREE.CylinderGeometry(0.025 * size, 0.025 * size, size, 8),
      new THREE.MeshBasicMaterial({ color, depthTest: false, transparent: true }));
    rod.position.setComponent(axis, size / 2);
    if (axis === 0) rod.rotation.z = -Math.PI / 2;
    if (axis === 2) rod.rotation.x = Math.PI / 2;
    rod.renderOrder = 5;
    group.add(rod);
  });
  group.add(label(name, size, below));
  viewer.scene_tree.find(["frames", node, "axes"]).set_object(group);
}

function label(text, size, below) {
  const canvas = document.createElement("canvas"), pen = /** @type {any} */ (canvas.getContext("2d")), font = `600 40px ${settings.theme.font}`;
  pen.font = font;
  canvas.width = Math.ceil(pen.measureText(text).width) + 24;
  canvas.height = 56;
  pen.font = font;
  pen.fillStyle = settings.theme.veil;
  pen.fillRect(0, 0, canvas.width, canvas.height);
  pen.fillStyle = settings.theme.ink;
  pen.fillText(text, 12, 42);
  const map = new THREE.CanvasTexture(canvas);
  map.minFilter = THREE.LinearFilter;
  const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map, depthTest: false, sizeAttenuation: false }));
  sprite.scale.set((0.0125 * canvas.width) / canvas.height, 0.0125, 1);
  sprite.center.set(0, -1.1 * below);
  sprite.position.setScalar(0.12 * size);
  sprite.renderOrder = 6;
  return sprite;
}

// --- the bodies of a contact are red while contacts are visible ---
const touching = settings.touching.flatMap(meshesUnder).map((mesh) => [mesh.material, mesh.material.color.clone()]);
const alarm = new THREE.Color(settings.theme.alarm);
function redden(on) {
  for (const [material, own] of touching) material.color.copy(own).lerp(alarm, on ? 0.78 : 0);
}

// --- switches ---
function setLayer(name, shown) {
  const layer = settings.layers.find((candidate) => candidate.name === name);
  for (const node of layer.nodes) viewer.scene_tree.find(node).object.visible = shown;
  if (name === "contact") redden(shown);
  layer.shown = shown;
  byId("layer-" + name).checked = shown;
  viewer.set_dirty();
}
for (const layer of settings.layers) {
  const line = make("label"), box = Object.assign(make("input"), { type: "checkbox", id: "layer-" + layer.name });
  box.addEventListener("change", () => setLayer(layer.name, box.checked));
  line.append(box, layer.label, " ", make("small", layer.note));
  byId("layers").append(line);
  setLayer(layer.name, layer.shown);
}

const moment = byId("moment");
moment.hidden = settings.start === null;
moment.addEventListener("click", () => seek(settings.start));

// --- a live page receives commands; it reconnects by itself, and reloads if the identifier of the page has changed ---
let source = null;
if (settings.live !== null) {
  const away = byId("away");
  source = new EventSource("events");
  source.onmessage = (event) => { for (const command of JSON.parse(event.data)) viewer.handle_command(command); };
  source.onerror = () => { away.hidden = false; };
  source.addEventListener("page", (event) => {
    away.hidden = true;
    if (event.data !== settings.live) location.reload();
  });
  source.addEventListener("closed", () => { away.hidden = false; });
}
Object.assign(window.pinproof, { setLayer, events: source });
