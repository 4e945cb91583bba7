// A page that computes: sliders of the joints, a target and bodies to drag, and at every pose the contacts, the closest
// pair, the joint limits and the manipulability. It computes in the page, with the core as WebAssembly (compute.js).
const web = settings.web;

/** Matrices (16, row by row) as those of three.js, and back. @param {ArrayLike<number>} rows */
const matrixOf = (rows) => new THREE.Matrix4().fromArray([...rows]).transpose();
/** @param {THREE.Matrix4} matrix */
const rowsOf = (matrix) => matrix.clone().transpose().toArray();
const millimetres = (metres) => (1000 * metres).toFixed(Math.abs(metres) < 0.1 ? 1 : 0) + " mm";
const DEGREE = Math.PI / 180;

async function startLive() {
  if (typeof WebAssembly !== "object" || typeof DecompressionStream !== "function") return;
  const [core, numbers] = await Promise.all(["core", "cell"].map((id) => unpack(byId(id).textContent)));
  const model = await CellModel.load(core, new Float64Array(numbers), web.arms.length);
  let q = [...web.q];        // the configuration shown
  let trying = false;        // whether it is the user's, and not that of the motion
  let checked = model.check(q), branches = null, branch = 0, reason = "";
  /** What was moved: root_from_thing by name; "" is the robot. @type {Map<string, THREE.Matrix4>} */
  const moved = new Map();
  const obstacles = new Map(web.obstacles.map((thing) => [thing.name, thing]));
  const tree = (...path) => viewer.scene_tree.find(path.map((name) => name.replaceAll("/", "\u2215")));

  // --- panel ---
  const panel = byId("live");
  const details = make("details"), state = make("p", "", "state"), pair = make("p", "", "state"), say = make("p", "", "reason");
  state.id = "live-state";
  pair.id = "live-pair";
  say.id = "live-reason";
  say.setAttribute("role", "status");
  details.append(make("summary", "Try other poses"));
  panel.append(state, pair, details);
  const field = (label, value, step) => Object.assign(make("input"), { type: "number", step, value, ariaLabel: label });
  const joints = web.joints.map((joint, k) => {
    const line = make("label", "", "joint"), slider = make("input"), entry = field(joint.name + " in " + joint.unit, 0, 0.01);
    Object.assign(slider, { type: "range", min: joint.lower, max: joint.upper, step: "any", ariaLabel: joint.name });
    const take = (input) => () => {
      if (input.value === "" || !isFinite(Number(input.value))) return;
      const other = [...q];
      other[k] = Number(input.value);
      branches = null;
      reason = "";
      tryPose(other);
    };
    slider.addEventListener("input", take(slider));
    entry.addEventListener("change", take(entry));
    line.append(make("span", joint.name), slider, entry);
    details.append(line);
    return { joint, slider, entry, line };
  });

  // What is dragged: the target of an arm, the robot, or an obstacle
  const things = make("select");
  things.ariaLabel = "What is moved";
  things.id = "live-thing";
  web.arms.forEach((arm, k) => things.append(new Option("Target of " + arm.name, "arm " + k)));
  things.append(new Option("Robot (its base)", "robot"));
  for (const name of obstacles.keys()) things.append(new Option(name, "obstacle " + name));
  const snap = make("select");
  snap.ariaLabel = "Snapping";
  for (const [text, value] of [["no snapping", 0], ["1 mm, 1\u00b0", 1], ["10 mm, 5\u00b0", 10], ["50 mm, 15\u00b0", 50]])
    snap.append(new Option(text, String(value)));
  const place = ["x [mm]", "y [mm]", "z [mm]", "roll [\u00b0]", "pitch [\u00b0]", "yaw [\u00b0]"].map((label) => {
    const line = make("label", label), entry = field(label, 0, "any");
    entry.addEventListener("change", () => {
      const values = place.map(({ entry: input }) => Number(input.value));
      if (values.every(Number.isFinite)) moveTo(poseOf(values), true);
    });
    line.append(entry);
    return { line, entry };
  });
  const box = make("div", "", "place");
  box.append(...place.map(({ line }) => line));
  const buttons = make("div", "", "buttons");
  const button = (text, act) => {
    const one = Object.assign(make("button", text), { type: "button" });
    one.addEventListener("click", act);
    buttons.append(one);
    return one;
  };
  const next = button("Next IK solution", () => {
    if (!branches?.q.length) return;
    branch = (branch + 1) % branches.q.length;
    tryPose(branches.q[branch]);
  });
  next.id = "live-next";
  const copy = (text) => {
    out.value = text;
    out.hidden = false;
    out.select();
    navigator.clipboard?.writeText(text).catch(() => {});
  };
  button("Copy as YAML", () => copy(asYaml())).id = "live-yaml";
  button("Copy as command", () => copy(asCommand())).id = "live-command";
  button("Undo all", () => {
    for (const name of [...moved.keys()]) displace(name, null);
    trying = false;
    reason = "";
    branches = null;
    q = [...web.q];
    shown = NaN;
    refresh();
  }).id = "live-undo";
  const out = Object.assign(make("textarea"), { hidden: true, readOnly: true, rows: 4, ariaLabel: "The change as text", id: "live-text" });
  details.append(things, snap, box, say, buttons, out);
  panel.hidden = false;

  // --- poses of what is dragged: metres and fixed-axis angles ---
  function poseOf([x, y, z, roll, pitch, yaw]) {
    const turn = new THREE.Euler(roll * DEGREE, pitch * DEGREE, yaw * DEGREE, "ZYX");
    return new THREE.Matrix4().makeRotationFromEuler(turn).setPosition(x / 1000, y / 1000, z / 1000);
  }
  function valuesOf(matrix) {
    const at = new THREE.Vector3().setFromMatrixPosition(matrix), turn = new THREE.Euler().setFromRotationMatrix(matrix, "ZYX");
    return [...at.toArray().map((v) => 1000 * v), turn.x / DEGREE, turn.y / DEGREE, turn.z / DEGREE];
  }
  const target = web.arms.map(() => /** @type {THREE.Matrix4 | null} */ (null));  // where it is not that of the tcp
  function poseNow() {
    const [kind, ...rest] = things.value.split(" "), name = rest.join(" ");
    if (kind === "arm") return target[Number(name)] ?? new THREE.Matrix4().fromArray([...checked.poses[web.arms[Number(name)].tcp]]);
    if (kind === "robot") return moved.get("") ?? new THREE.Matrix4();
    return moved.get(name) ?? matrixOf(obstacles.get(name).pose);
  }

  // Move what is selected; `exact` without snapping.
  function moveTo(pose, exact = false) {
    if (!(Math.abs(pose.determinant() - 1) < 1e-3 && pose.elements.every((v) => Math.abs(v) < 1e6))) return;  // no pose of a cell
    const step = Number(snap.value), [kind, ...rest] = things.value.split(" "), name = rest.join(" ");
    if (step && !exact) {
      const turn = { 1: 1, 10: 5, 50: 15 }[step];
      pose = poseOf(valuesOf(pose).map((v, k) => (k < 3 ? step : turn) * Math.round(v / (k < 3 ? step : turn))));
    }
    if (kind !== "arm") {
      displace(kind === "robot" ? "" : name, pose);
      refresh();
      return;
    }
    // The nearest solution; without one, the reason
    const arm = Number(name), rows = rowsOf(pose), solution = model.solve(arm, rows, q);
    branches = model.branches(arm, rows, q);
    branch = 0;
    target[arm] = null;
    if (solution?.reached) {
      reason = "";
      tryPose(solution.q);
    } else if (solution !== null) {
      target[arm] = pose;
      const far = millimetres(solution.position) + ", " + (solution.orientation / DEGREE).toFixed(1) + "\u00b0";
      reason = branches?.complete && branches.outside && !branches.q.length
        ? "Unreachable: all " + branches.outside + " solutions are outside the joint limits."
        : (branches?.complete && !branches.q.length ? "Unreachable: no configuration has this pose" : "Not reached")
          + "; the closest pose found is " + far + " away.";
      refresh();
    }
  }

  // Place the robot (name "") or an obstacle; null: where it was loaded.
  function displace(name, pose) {
    if (pose === null) moved.delete(name);
    else moved.set(name, pose);
    if (name === "") {
      model.move(-1, -1, rowsOf(pose ?? new THREE.Matrix4()));
      return;
    }
    const thing = obstacles.get(name), loaded = matrixOf(thing.pose), now = pose ?? loaded;
    model.move(...thing.bodies, rowsOf(now.clone().multiply(loaded.clone().invert())));
    tree("scene", name).set_transform(now.toArray());
  }

  function tryPose(other) {
    if (!other.every(Number.isFinite)) return;
    if (animator.playing) animator.pause();
    trying = true;
    q = other;
    refresh();
  }

  // --- what is shown at a pose ---
  const group = new THREE.Group(), line = new THREE.Line(new THREE.BufferGeometry().setFromPoints([new THREE.Vector3(), new THREE.Vector3()]),
    new THREE.LineBasicMaterial({ color: settings.theme.accent, depthTest: false, transparent: true }));
  line.renderOrder = 7;
  line.frustumCulled = false;
  group.add(line);
  viewer.scene_tree.find(["live"]).set_object(group);
  const gap = byId("stage").appendChild(make("output", "", "gap"));
  gap.id = "gap";
  const alarm = new THREE.Color(settings.theme.alarm), painted = new Map();
  const meshesOf = (owner) => obstacles.has(owner) ? meshesUnder(["scene", owner.replaceAll("/", "\u2215")]) : meshesUnder(["robot", owner.replaceAll("/", "\u2215")]);
  function paint(owners) {
    for (const [owner, meshes] of painted) if (!owners.has(owner)) for (const [mesh, own] of meshes) mesh.material.color.copy(own);
    for (const owner of [...painted.keys()]) if (!owners.has(owner)) painted.delete(owner);
    for (const owner of owners) {
      if (painted.has(owner)) continue;
      painted.set(owner, meshesOf(owner).map((mesh) => [mesh, mesh.material.color.clone()]));
      for (const [mesh, own] of painted.get(owner)) mesh.material.color.copy(own).lerp(alarm, 0.78);
    }
  }
  const nameOf = (body) => web.owners[body] ?? "";

  function refresh() {
    const now = model.check(q);
    if (now === null) return;
    checked = now;
    const { contacts, closest } = checked, outside = joints.filter(({ joint }, k) => q[k] < joint.lower - 1e-9 || q[k] > joint.upper + 1e-9);
    // Words: what is proven, and what is only checked
    const margin = web.margin > 0 ? " and a margin of " + millimetres(web.margin) : "";
    const only = "Only this pose is checked" + margin + "; nothing is proven about motions.";
    const proven = settings.duration > 0 && web.proven ? "Proven: the motion. " : "";
    state.textContent = moved.size ? "The cell was changed: " + (proven ? "the proof of the motion does not hold for it. " : "") + only
      : trying ? proven + "Shown is another pose. " + only : proven + "Checked now: the pose shown.";
    const touching = [...new Set(contacts.map(({ a, b, lower }) =>
      nameOf(a) + (lower > 0 ? " is " + millimetres(lower) + " from " : " is in contact with ") + nameOf(b)))];
    pair.textContent = touching.length ? touching.slice(0, 4).join("; ") + (touching.length > 4 ? " and " + (touching.length - 4) + " more" : "")
      : closest && isFinite(closest.lower) ? "Closest: " + nameOf(closest.a) + " and " + nameOf(closest.b) + ", " + millimetres(closest.lower) : "No pair of bodies is checked.";
    if (outside.length) pair.textContent += ". Outside its limits: " + outside.map(({ joint }) => joint.name).join(", ");
    pair.className = touching.length || outside.length ? "state bad" : "state good";
    pair.title = web.arms.map((arm, k) => "Manipulability of " + arm.name + ": " + checked.manipulability[k].toPrecision(3)).join("\n");
    // The closest pair with its line
    const apart = !touching.length && closest && isFinite(closest.lower);
    line.visible = Boolean(apart);
    if (apart) {
      closest.points.forEach((point, k) => line.geometry.attributes.position.setXYZ(k, ...point));
      line.geometry.attributes.position.needsUpdate = true;
    }
    gap.textContent = apart ? millimetres(closest.lower) : "";
    if (trying || moved.size) redden(false);
    paint(new Set(trying || moved.size || !settings.touching.length ? contacts.flatMap(({ a, b }) => [nameOf(a), nameOf(b)]) : []));
    // Controls
    joints.forEach(({ slider, entry, line: row, joint }, k) => {
      slider.value = String(q[k]);
      if (document.activeElement !== entry) entry.value = q[k].toFixed(3);
      row.classList.toggle("bad", q[k] < joint.lower - 1e-9 || q[k] > joint.upper + 1e-9);
    });
    const values = valuesOf(poseNow());
    place.forEach(({ entry }, k) => { if (document.activeElement !== entry) entry.value = values[k].toFixed(1); });
    say.textContent = reason || (branches && branches.q.length ? "Solution " + (branch + 1) + " of " + branches.q.length + "." : "");
    say.classList.toggle("bad", reason !== "");
    next.disabled = !branches || branches.q.length < 2;
    if (details.open) gizmo.show(poseNow(), reason !== "");
    viewer.set_dirty();
  }

  // --- the motion: its configuration at a time; every frame shows the poses of the cell as it is ---
  let shown = NaN, placed = false;
  const motion = web.motion;
  function atTime(t) {
    const times = motion.times, n = q.length;
    let k = 0;
    while (k < times.length - 2 && times[k + 1] <= t) k++;
    const share = Math.min(Math.max((t - times[k]) / Math.max(times[k + 1] - times[k], 1e-12), 0), 1);
    return q.map((_, j) => motion.q[n * k + j] * (1 - share) + motion.q[n * k + n + j] * share);
  }
  const render = viewer.render.bind(viewer), middle = new THREE.Vector3();
  viewer.render = () => {
    const t = animator.time;
    if (motion && t !== shown && animator.actions.length) {
      if (!Number.isNaN(shown) || !trying) {
        trying = false;  // the player took over
        reason = "";
        q = atTime(t);
        shown = t;
        refresh();
      } else shown = t;
    }
    // Once more after the user's pose was left, because the player moves only what the motion moves
    const ours = trying || moved.size > 0;
    if (ours || placed) {
      placed = ours;
      web.frames.forEach((name, k) => {
        const pose = [...checked.poses[k]];
        if (viewer.scene_tree.find(["robot"]).children[name.replaceAll("/", "\u2215")]) tree("robot", name).set_transform(pose);
        if (viewer.scene_tree.find(["frames"]).children[name.replaceAll("/", "\u2215")]) tree("frames", name).set_transform(pose);
      });
    }
    render();
    gap.hidden = !line.visible;
    if (line.visible) {
      middle.set(0, 0, 0);
      for (const point of checked.closest.points) middle.add(new THREE.Vector3(...point).multiplyScalar(0.5));
      const { x, y, z } = group.localToWorld(middle).project(viewer.camera);
      gap.hidden = z > 1;
      gap.style.left = (50 + 50 * x) + "%";
      gap.style.top = (50 - 50 * y) + "%";
    }
  };

  // --- the handle: a ball that is dragged in the plane of the picture, arrows and rings ---
  const gizmo = (() => {
    const handle = new THREE.Group(), parts = [];
    const size = 0.09 * Math.max(...points.map((p) => p.distanceTo(points[0])));
    const add = (geometry, colour, kind, axis) => {
      const part = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ color: colour, depthTest: false, transparent: true, opacity: 0.85 }));
      part.renderOrder = 8;
      part.userData = { kind, axis, colour: new THREE.Color(colour) };
      parts.push(part);
      handle.add(part);
      return part;
    };
    settings.theme.axes.forEach((colour, axis) => {
      const arrow = add(new THREE.ConeGeometry(0.11 * size, 0.35 * size, 12), colour, "arrow", axis);
      arrow.position.setComponent(axis, size);
      if (axis === 0) arrow.rotation.z = -Math.PI / 2;
      if (axis === 2) arrow.rotation.x = Math.PI / 2;
      const ring = add(new THREE.TorusGeometry(0.7 * size, 0.03 * size, 8, 48), colour, "ring", axis);
      if (axis === 0) ring.rotation.y = Math.PI / 2;
      if (axis === 1) ring.rotation.x = Math.PI / 2;
    });
    add(new THREE.SphereGeometry(0.16 * size, 20, 14), settings.theme.accent, "ball", 0);
    handle.visible = false;
    group.add(handle);
    const caster = new THREE.Raycaster(), mouse = new THREE.Vector2();
    let drag = null;
    // The ray of a pointer, in the frame of the robot's root
    const rayOf = (event) => {
      const bounds = pane.getBoundingClientRect();
      mouse.set(2 * (event.clientX - bounds.left) / bounds.width - 1, 1 - 2 * (event.clientY - bounds.top) / bounds.height);
      // The pointer may come before the next frame is drawn, which would update these.
      viewer.camera.updateWorldMatrix(true, false);
      group.updateWorldMatrix(true, true);
      caster.setFromCamera(mouse, viewer.camera);
      return caster.ray.clone().applyMatrix4(group.matrixWorld.clone().invert());
    };
    const onPlane = (ray, normal, at) => ray.intersectPlane(new THREE.Plane().setFromNormalAndCoplanarPoint(normal, at), new THREE.Vector3());
    const alongAxis = (ray, axis, at) => {
      const normal = axis.clone().cross(ray.direction).cross(axis).normalize();
      const hit = onPlane(ray, normal, at);
      return hit === null ? null : hit.sub(at).dot(axis);
    };
    pane.addEventListener("pointerdown", (event) => {
      if (!handle.visible) return;
      const ray = rayOf(event), hit = caster.intersectObjects(parts)[0];
      if (!hit) return;
      event.stopPropagation();
      event.preventDefault();
      viewer.controls.enabled = false;
      pane.setPointerCapture(event.pointerId);
      const start = poseNow().clone(), at = new THREE.Vector3().setFromMatrixPosition(start), { kind, axis } = hit.object.userData;
      const direction = kind === "ball" ? ray.direction.clone().negate() : new THREE.Vector3().setFromMatrixColumn(start, axis).normalize();
      const from = kind === "arrow" ? alongAxis(ray, direction, at) : onPlane(ray, direction, at);
      if (from !== null) drag = { kind, start, at, direction, from, pointer: event.pointerId };
    }, true);
    pane.addEventListener("pointermove", (event) => {
      if (drag === null || event.pointerId !== drag.pointer) return;
      event.stopPropagation();
      const ray = rayOf(event), { kind, start, at, direction, from } = drag, pose = start.clone();
      if (kind === "arrow") {
        const along = alongAxis(ray, direction, at);
        if (along === null) return;
        pose.setPosition(at.clone().addScaledVector(direction, along - from));
      } else {
        const hit = onPlane(ray, direction, at);
        if (hit === null) return;
        if (kind === "ball") pose.setPosition(at.clone().add(hit.sub(from)));
        else {
          const one = from.clone().sub(at), other = hit.sub(at);
          const angle = Math.atan2(one.clone().cross(other).dot(direction), one.dot(other));
          pose.setPosition(0, 0, 0).premultiply(new THREE.Matrix4().makeRotationAxis(direction, angle)).setPosition(at);
        }
      }
      moveTo(pose);
    }, true);
    for (const name of ["pointerup", "pointercancel"]) {
      pane.addEventListener(name, () => {
        drag = null;
        viewer.controls.enabled = true;
      }, true);
    }
    return {
      size,
      show(pose, bad) {
        handle.visible = true;
        handle.position.setFromMatrixPosition(pose);
        handle.quaternion.setFromRotationMatrix(pose);
        for (const part of parts) part.material.color.copy(bad ? alarm : part.userData.colour);
      },
      hide() { handle.visible = false; },
    };
  })();
  details.addEventListener("toggle", () => {
    if (details.open) gizmo.show(poseNow(), reason !== "");
    else gizmo.hide();
    viewer.set_dirty();
  });
  things.addEventListener("change", () => {
    branches = null;
    reason = "";
    refresh();
  });

  // --- the change as text, for the person who computes the certificate ---
  const plain = (name) => /^[A-Za-z_][\w.-]*$/.test(name) ? name : JSON.stringify(name);
  const short = (v) => String(Number(v.toFixed(6)));
  const poseText = (matrix) => {
    const v = valuesOf(matrix), rpy = v.slice(3).map((x) => short(x * DEGREE));
    return "xyz: [" + v.slice(0, 3).map((x) => short(x / 1000)).join(", ") + "]" + (rpy.every((x) => x === "0") ? "" : ", rpy: [" + rpy.join(", ") + "]");
  };
  function asYaml() {
    const lines = ["q: [" + q.map(short).join(", ") + "]  # " + web.joints.map(({ name }) => JSON.stringify(name).slice(1, -1)).join(", ")];
    for (const [name, pose] of moved) {
      if (name === "") lines.push("base: {" + poseText(pose) + "}  # world_from_robot");
      else lines.push("- {name: " + plain(name) + ", " + poseText(pose) + "}  # obstacles");
    }
    return lines.join("\n");
  }
  const quoted = (text) => /^[\w./-]+$/.test(text) ? text : "'" + text.replaceAll("'", "'\\''") + "'";
  function asCommand() {
    const note = moved.size ? "  # after the change of the scene" : "";
    return "pinproof check " + quoted(web.robot) + " --q '" + q.map(short).join(" ") + "'" + note;
  }

  refresh();
  window.pinproof.model = { model, moveTo, tryPose, displace, matrixOf, now: () => ({ q, checked, trying, reason, branches, moved }) };
}
// Without WebAssembly the page shows what it was written with.
window.pinproof.live = web ? startLive().catch((error) => { byId("live").hidden = true; console.info("pinproof: this page does not compute: " + error); })
  : Promise.resolve();
