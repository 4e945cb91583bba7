"use strict";
// Hands the commands to meshcat's viewer, frames the robot, and runs the player beside it.
(function () {
  const byId = (id) => document.getElementById(id);
  const settings = JSON.parse(byId("settings").textContent);
  const pane = byId("meshcat-pane");
  const viewer = new MeshCat.Viewer(pane);

  // meshcat sizes itself by the window; here it has the part of it that the caption leaves.
  const resize = viewer.set_3d_pane_size.bind(viewer);
  viewer.set_3d_pane_size = () => {
    resize(pane.clientWidth, pane.clientHeight);
    if (!touched) frame();
  };

  // Arrays stand in one binary blob; a {"$buffer": [type, offset, count]} is the place of one.
  const bytes = Uint8Array.from(atob(byId("buffers").textContent), (c) => c.charCodeAt(0));
  const arrays = { Float32Array, Int8Array, Uint16Array, Uint32Array };
  const commands = JSON.parse(byId("commands").textContent, (key, value) => {
    if (value === null || typeof value !== "object" || !value.$buffer) return value;
    const [type, offset, count] = value.$buffer;
    return new arrays[type](bytes.buffer, offset, count);
  });

  // --- camera: three.js is y-up inside meshcat, so (x, y, z) of the robot's root frame is (x, z, -y) here ---
  let touched = false;
  const vector = ([x, y, z]) => new MeshCat.THREE.Vector3(x, z, -y);
  const toCamera = vector(settings.direction).normalize();
  const right = new MeshCat.THREE.Vector3(0, 1, 0).cross(toCamera).normalize();
  const up = toCamera.clone().cross(right);
  const points = settings.points.map(vector);

  // The same closed form as pinproof.viewer.camera.fit, for the canvas as it is now.
  function frame() {
    const camera = viewer.camera, aspect = pane.clientWidth / Math.max(1, pane.clientHeight);
    const tangent = Math.tan((settings.fieldOfView * Math.PI) / 360) * 0.95;
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
    const distance = Math.max(...depths);
    const middle = points.reduce((sum, p) => sum + p.dot(toCamera), 0) / points.length;
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

  for (const command of commands) viewer.handle_command(command);
  viewer.gui.close();
  viewer.controls.addEventListener("start", () => { touched = true; });
  byId("reset").addEventListener("click", () => { touched = false; frame(); });
  viewer.set_3d_pane_size();

  // --- player: drives meshcat's own animator, so that its control panel and this one never disagree ---
  const animator = viewer.animator, moving = animator.actions.length > 0;
  const play = byId("play"), scrub = byId("scrub"), clock = byId("clock");
  const seconds = (t) => t.toFixed(2);

  function seek(t) {
    if (!moving) return;
    animator.play();  // only running actions take a new time
    animator.pause();
    const at = Math.min(Math.max(t, 0), settings.duration);
    animator.seek(at);
    animator.display_progress(at);
  }

  function fromAddress() {
    const found = /(?:^#|&)t=([0-9.]+)/.exec(location.hash);
    if (found && isFinite(Number(found[1]))) seek(Number(found[1]));
    return Boolean(found);
  }

  function show() {
    const t = Math.min(animator.time, settings.duration), label = animator.playing ? "Pause" : "Play";
    if (play.textContent !== label) {
      play.textContent = label;
      play.setAttribute("aria-pressed", String(animator.playing));
    }
    if (document.activeElement !== scrub || animator.playing) scrub.value = t;
    const text = seconds(t) + " / " + seconds(settings.duration) + " s";
    if (clock.textContent !== text) clock.textContent = text;
    requestAnimationFrame(show);
  }

  if (moving) {
    byId("player").hidden = false;
    scrub.max = settings.duration;
    play.addEventListener("click", () => (animator.playing ? animator.pause() : animator.play()));
    scrub.addEventListener("input", () => seek(Number(scrub.value)));
    window.addEventListener("hashchange", fromAddress);
    const calm = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (!fromAddress() && !calm) animator.play();
    show();
  }

  // --- live: the server this page came from sends further commands ---
  let source = null;
  if (settings.live) {
    source = new EventSource("events");
    source.onmessage = (event) => { for (const command of JSON.parse(event.data)) viewer.handle_command(command); };
    source.addEventListener("reload", () => location.reload());
    source.addEventListener("closed", () => {
      source.close();
      byId("reason").textContent = "The live view was closed; the picture stays. " + byId("reason").textContent;
    });
  }

  window.pinproof = { viewer, seek, settings, events: source, ready: true };
})();
