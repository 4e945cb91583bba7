// What pages that compute show at a configuration: links where they are, contacts in red, the closest pair and figures.
const millimetres = (metres) => (1000 * metres).toFixed(Math.abs(metres) < 0.1 ? 1 : 0) + " mm";
const nodeOf = (...path) => viewer.scene_tree.find(path.map((name) => name.replaceAll("/", "\u2215")));

/** Draw links and frames at their poses. */
function placeFrames(names, poses) {
  names.forEach((name, k) => {
    for (const root of ["robot", "frames"]) {
      if (viewer.scene_tree.find([root]).children[name.replaceAll("/", "\u2215")]) nodeOf(root, name).set_transform([...poses[k]]);
    }
  });
}

/** How far a value is inside the limits of its joint, of which either may be missing. */
const insideBy = ({ limits: [lower, upper] }, value) => Math.min(value - (lower ?? -Infinity), (upper ?? Infinity) - value);
const outsideLimits = (web, q) => web.joints.filter((joint, k) => insideBy(joint, q[k]) < -1e-9);

/** The contacts in words, each pair of names once, and what is stated: these or the closest pair. */
function describeContacts(web, contacts, closest) {
  const nameOf = (body) => web.owners[body] ?? "";
  const touching = [...new Set(contacts.map(({ a, b, lower }) =>
    nameOf(a) + (lower > 0 ? " is " + millimetres(lower) + " from " : " is in contact with ") + nameOf(b)))];
  const text = touching.length ? touching.slice(0, 4).join("; ") + (touching.length > 4 ? " and " + (touching.length - 4) + " more" : "")
    : closest && isFinite(closest.lower) ? "Closest: " + nameOf(closest.a) + " and " + nameOf(closest.b) + ", " + millimetres(closest.lower) : "No pair of bodies is checked.";
  return { touching, text };
}

/** A certificate without its checker does not have the margins of single pairs. */
const unknownMargins = ({ knownMargins }) => knownMargins ? "" : " Margins of single pairs that the scene does not state are unknown to this page.";

/** Joints outside their limits, else the one nearest to a limit, and the manipulability of each arm. */
function figuresOf(web, checked, q) {
  const outside = outsideLimits(web, q), margins = web.joints.map((joint, k) => insideBy(joint, q[k]));
  const least = margins.indexOf(Math.min(...margins)), joint = web.joints[least];
  const distance = joint.unit === "rad" ? (margins[least] / DEGREE).toFixed(1) + "\u00b0" : millimetres(margins[least]);
  const limits = outside.length ? "Outside its limits: " + outside.map(({ name }) => name).join(", ") : isFinite(margins[least]) ? "Nearest limit: " + joint.name + ", " + distance : "No joint limits";
  const named = web.arms.length > 1, volumes = web.arms.map(({ name }, k) => (named ? name + " " : "") + checked.manipulability[k].toPrecision(3));
  return limits + ". Manipulability: " + volumes.join(", ");
}

function pictureOf(obstacles) {
  const group = new THREE.Group(), line = new THREE.Line(new THREE.BufferGeometry().setFromPoints([new THREE.Vector3(), new THREE.Vector3()]),
    new THREE.LineBasicMaterial({ color: settings.theme.accent, depthTest: false, transparent: true }));
  Object.assign(line, { renderOrder: 7, frustumCulled: false, visible: false });
  group.add(line);
  viewer.scene_tree.find(["live"]).set_object(group);
  const gap = byId("stage").appendChild(make("output", "", "gap")), middle = new THREE.Vector3();
  Object.assign(gap, { id: "gap", hidden: true });
  const alarm = new THREE.Color(settings.theme.alarm), painted = new Map();
  return {
    group,
    /** The closest pair with its line; null for none. */
    drawPair(closest) {
      line.visible = Boolean(closest && isFinite(closest.lower));
      if (!line.visible) return;
      closest.points.forEach((point, k) => line.geometry.attributes.position.setXYZ(k, ...point));
      line.geometry.attributes.position.needsUpdate = true;
      middle.addVectors(...closest.points.map((point) => new THREE.Vector3(...point))).multiplyScalar(0.5);
      gap.textContent = millimetres(closest.lower);
    },
    /** The distance beside its line, in every frame. */
    placeGap() {
      const { x, y, z } = group.localToWorld(middle.clone()).project(viewer.camera);
      gap.hidden = !line.visible || z > 1;
      gap.style.left = `min(${50 + 50 * x}%, calc(100% - 6em))`;
      gap.style.top = (50 - 50 * y) + "%";
    },
    /** Only what has these names is red. @param {Set<string>} owners */
    paint(owners) {
      for (const [owner, meshes] of painted) {
        if (owners.has(owner)) continue;
        for (const [mesh, own] of meshes) mesh.material.color.copy(own);
        painted.delete(owner);
      }
      for (const owner of owners) {
        if (painted.has(owner)) continue;
        const meshes = meshesUnder([obstacles.has(owner) ? "scene" : "robot", owner.replaceAll("/", "\u2215")]);
        painted.set(owner, meshes.map((mesh) => [mesh, mesh.material.color.clone()]));
        for (const [mesh, own] of painted.get(owner)) mesh.material.color.copy(own).lerp(alarm, 0.78);
      }
    },
  };
}
