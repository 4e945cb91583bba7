// The player controls meshcat's animator.
const animator = viewer.animator;
const play = byId("play"), scrub = byId("scrub"), clock = byId("clock"), speed = byId("speed");
let duration = 0;
let parameter = null;  // of a self-motion: the slider shows its value instead of a time

function seek(t) {
  if (animator.actions.length === 0) return;
  animator.play();  // only running actions take a new time
  animator.pause();
  const at = Math.min(Math.max(t, 0), duration);
  animator.seek(at);
  animator.display_progress(at);
}

function fromAddress() {
  const found = /(?:^#|&)t=([0-9.]+)/.exec(location.hash);
  if (found && isFinite(Number(found[1]))) seek(Number(found[1]));
  return Boolean(found);
}

function show() {
  const t = Math.min(animator.time, duration), label = animator.playing ? "Pause" : "Play";
  if (play.textContent !== label) {
    play.textContent = label;
    play.setAttribute("aria-pressed", String(animator.playing));
  }
  if (document.activeElement !== scrub || animator.playing) scrub.value = t;
  const text = parameter ? parameter.name + " = " + (parameter.first + t).toFixed(3) + " " + parameter.unit
    : t.toFixed(2) + " / " + duration.toFixed(2) + " s";
  if (clock.textContent !== text) clock.textContent = text;
  requestAnimationFrame(show);
}

// Show the player for a motion of the given duration, if there is one. The motion starts unless it shall be paused at a
// time (start, or t in the URL), or the user prefers reduced motion. The slider of a joint (varied) is paused at its value.
function offer(seconds, start = null, varied = null) {
  duration = seconds;
  parameter = varied;
  const moving = animator.actions.length > 0;
  byId("player").hidden = !moving;
  if (!moving) return;
  scrub.max = duration;
  const calm = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
  if (parameter) {
    scrub.setAttribute("aria-label", parameter.name + " in " + parameter.unit);
    scrub.title = parameter.name;
  }
  if (fromAddress()) return;
  if (parameter) {
    seek(parameter.shown - parameter.first);
    return;
  }
  if (start !== null) seek(start);
  else if (!calm) animator.play();
}

// Scroll a list to a row. scrollIntoView would also scroll the page, on a narrow screen away from the picture.
function reveal(row, list) {
  const inner = row.getBoundingClientRect(), outer = list.getBoundingClientRect();
  const head = list.querySelector("thead")?.offsetHeight ?? 0;  // it covers the first row
  list.scrollTop += Math.min(inner.top - outer.top - head, 0) || Math.max(inner.bottom - outer.bottom, 0);
}

function toggle() {
  if (animator.playing) animator.pause();
  else animator.play();
}

// Keyboard shortcuts of the page, unless the focused element uses the key.
const STEP = 1 / 30;
window.addEventListener("keydown", (event) => {
  if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target.closest("input:not([type=checkbox]), select, button, textarea, summary")) return;
  if (event.key === "r" || event.key === "R") byId("reset").click();
  if (animator.actions.length === 0) return;
  if (event.key === " " && !event.target.closest("input")) toggle();
  else if (event.key === "ArrowLeft") seek(animator.time - STEP);
  else if (event.key === "ArrowRight") seek(animator.time + STEP);
  else return;
  event.preventDefault();
});

play.addEventListener("click", toggle);
if (speed) speed.addEventListener("change", () => { animator.mixer.timeScale = Number(speed.value); });
scrub.addEventListener("input", () => seek(Number(scrub.value)));
window.addEventListener("hashchange", fromAddress);
show();
