// What is moved in a page that computes: poses as numbers and as text, snapping, and a handle of arrows and rings.
/** Matrices (16, row by row) as those of three.js, and back. @param {Iterable<number>} rows */
const matrixOf = (rows) => new THREE.Matrix4().fromArray([...rows]).transpose();
const rowsOf = (matrix) => matrix.clone().transpose().toArray();
const DEGREE = Math.PI / 180;

/** A pose as metres and fixed-axis angles, in mm and degrees. @param {number[]} values */
function poseOf([x, y, z, roll, pitch, yaw]) {
  const turn = new THREE.Euler(roll * DEGREE, pitch * DEGREE, yaw * DEGREE, "ZYX");
  return new THREE.Matrix4().makeRotationFromEuler(turn).setPosition(x / 1000, y / 1000, z / 1000);
}
function valuesOf(matrix) {
  const at = new THREE.Vector3().setFromMatrixPosition(matrix), turn = new THREE.Euler().setFromRotationMatrix(matrix, "ZYX");
  return [...at.toArray().map((v) => 1000 * v), turn.x / DEGREE, turn.y / DEGREE, turn.z / DEGREE];
}
const isPose = (pose) => Math.abs(pose.determinant() - 1) < 1e-3 && pose.elements.every((v) => Math.abs(v) < 1e6);

// --- as text, for the person who computes the certificate ---
const escaped = (name) => JSON.stringify(name).replace(/[\x7f-\x9f\u2028\u2029\ufeff]/g, (c) => "\\u" + c.charCodeAt(0).toString(16).padStart(4, "0"));  // no YAML
const plain = (name) => /^(?!(?:y|n|yes|no|on|off|true|false|null)$)[a-z_][\w.-]*$/i.test(name) ? name : escaped(name);
const quoted = (text) => /^\w[\w./-]*$/.test(text) ? text : "'" + text.replaceAll("'", "'\\''") + "'";
const short = (v) => String(Number(v.toFixed(9)) || 0);  // a joint at its limit is within it when the text is read again
const poseText = (matrix, full = false) => {
  const v = valuesOf(matrix), rpy = v.slice(3).map((x) => short(x * DEGREE));
  return "xyz: [" + v.slice(0, 3).map((x) => short(x / 1000)).join(", ") + "]" + (!full && rpy.every((x) => x === "0") ? "" : ", rpy: [" + rpy.join(", ") + "]");
};

const numberField = (label, value, step) => Object.assign(make("input"), { type: "number", step, value, ariaLabel: label });

// Buttons for the change as text and others, with the text that is copied.
function makeButtons(actions) {
  const buttons = make("div", "", "buttons");
  const out = Object.assign(make("textarea"), { hidden: true, readOnly: true, rows: 4, ariaLabel: "The change as text", id: "live-text" });
  for (const [id, text, act] of actions) {
    const one = Object.assign(make("button", text), { type: "button", id });
    one.addEventListener("click", () => {
      const copied = act();
      if (typeof copied !== "string") return;
      out.value = copied;
      out.hidden = false;
      out.select();
      navigator.clipboard?.writeText(copied).catch(() => {});
    });
    buttons.append(one);
  }
  return [buttons, out];
}

// The entries of a pose, which call `move` with what is entered, and the choices of snapping for the handle.
function poseEntries(move) {
  const choices = /** @type {[string, string, number[]][]} */ ([["Positions", "mm", [1, 5, 10]], ["Angles", "\u00b0", [1, 5, 15]]]).map(([what, unit, steps]) => {
    const label = make("label", what, "snap"), select = make("select");
    select.id = "snap-" + what.toLowerCase();
    for (const step of [0, ...steps]) select.append(new Option(step ? "in steps of " + step + (unit === "mm" ? " mm" : unit) : "not snapped", String(step)));
    label.append(select);
    return { label, select };
  });
  const box = make("div", "", "place");
  const lines = ["x [mm]", "y [mm]", "z [mm]", "roll [\u00b0]", "pitch [\u00b0]", "yaw [\u00b0]"].map((name) => {
    const line = make("label", name), entry = numberField(name, 0, "any");
    entry.addEventListener("change", () => {
      const values = lines.map((input) => Number(input.value));
      if (entry.value !== "" && values.every(Number.isFinite)) move(poseOf(values));
    });
    line.append(entry);
    box.append(line);
    return entry;
  });
  return {
    parts: [...choices.map(({ label }) => label), box],
    snapped(pose) {
      const steps = choices.map(({ select }) => Number(select.value));
      if (!steps[0] && !steps[1]) return pose;
      return poseOf(valuesOf(pose).map((v, k) => { const step = steps[k < 3 ? 0 : 1]; return step ? step * Math.round(v / step) : v; }));
    },
    show(pose, planar = false) {
      const values = valuesOf(pose);
      lines.forEach((entry, k) => {
        entry.disabled = planar && (k === 3 || k === 4);
        if (document.activeElement !== entry) entry.value = values[k].toFixed(1);
      });
    },
  };
}

// A ball that is dragged in the plane of the picture, arrows and rings; of what is planar, the ball is dragged on the
// floor, and only yaw is turned.
function makeHandle(group, poseNow, moveTo) {
  const handle = new THREE.Group(), parts = [], alarm = new THREE.Color(settings.theme.alarm), up = new THREE.Vector3(0, 0, 1);
  const size = 0.09 * Math.max(...points.map((p) => p.distanceTo(points[0])));
  let drag = null, planar = false, sharpness = 0;
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
  // After two pictures that took longer than 1/30 s, a quarter of the pixels is drawn, with the shadows as they are.
  const watch = (last, slow) => requestAnimationFrame((now) => {
    if (drag === null) return;
    slow = now - last > 1000 / 30 ? slow + 1 : 0;
    if (slow > 1 && !sharpness) {
      sharpness = viewer.renderer.getPixelRatio();
      viewer.renderer.setPixelRatio(sharpness / 2);
      viewer.renderer.shadowMap.autoUpdate = false;
    }
    watch(now, slow);
  });
  pane.addEventListener("pointerdown", (event) => {
    if (!handle.visible) return;
    const ray = rayOf(event), hit = caster.intersectObjects(parts.filter((part) => part.visible))[0];
    if (!hit) return;
    event.stopPropagation();
    event.preventDefault();
    viewer.controls.enabled = false;
    pane.setPointerCapture(event.pointerId);
    const start = poseNow().clone(), at = new THREE.Vector3().setFromMatrixPosition(start), { kind, axis } = hit.object.userData;
    const direction = kind === "ball" ? (planar ? up.clone() : ray.direction.clone().negate()) : new THREE.Vector3().setFromMatrixColumn(start, axis).normalize();
    const from = kind === "arrow" ? alongAxis(ray, direction, at) : onPlane(ray, direction, at);
    if (from === null) return;
    drag = { kind, start, at, direction, from, pointer: event.pointerId };
    watch(performance.now(), 0);
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
      if (!sharpness) return;
      viewer.renderer.setPixelRatio(sharpness);
      viewer.renderer.shadowMap.autoUpdate = true;
      sharpness = 0;
      viewer.set_dirty();
    }, true);
  }
  return {
    show(pose, bad, flat = false) {
      planar = flat;
      handle.visible = true;
      handle.position.setFromMatrixPosition(pose);
      handle.quaternion.setFromRotationMatrix(pose);
      for (const part of parts) {
        part.material.color.copy(bad ? alarm : part.userData.colour);
        part.visible = !planar || part.userData.kind !== "ring" || part.userData.axis === 2;
      }
    },
    hide() { handle.visible = false; },
  };
}
