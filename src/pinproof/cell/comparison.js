// Two pages of picks side by side, with one slider, one camera and one table.
"use strict";
(() => {
  /** @type {(id: string) => any} */
  const byId = (id) => document.getElementById(id);
  const { names, shared, titles, pages } = JSON.parse(byId("pages").textContent);
  /** @type {any[]} */
  const rows = [...document.querySelectorAll("tbody tr")], play = byId("play"), scrub = byId("scrub");
  let sides = [], leader = null, chosen = -1, duration = 0, time = 0, playing = false, before = 0;

  function show(seconds) {
    time = Math.min(Math.max(seconds, 0), duration);
    for (const side of sides) side.seek(time);  // the faster one waits at its end
    scrub.value = time;
    byId("clock").textContent = time.toFixed(2) + " / " + duration.toFixed(2) + " s";
  }

  function setPlaying(on) {
    playing = on && duration > 0;
    if (playing && time >= duration) time = 0;
    before = performance.now();
    play.textContent = playing ? "Pause" : "Play";
    play.setAttribute("aria-pressed", String(playing));
  }

  function choose(k) {
    chosen = k;
    rows.forEach((row, number) => { row.setAttribute("aria-selected", String(number === k)); row.tabIndex = number === k ? 0 : -1; });
    const motions = sides.map((side) => {
      const own = side.settings.picks.findIndex((pick) => pick.name === names[k]);
      side.choose(own);
      return side.settings.motions[own];
    });
    duration = Math.max(...motions.map((motion) => motion?.duration ?? 0));
    scrub.max = duration;
    byId("player").hidden = !duration;
    show(0);
  }

  function chooseByReader(k) {
    choose(k);
    setPlaying(true);
    try { history.replaceState(null, "", "#pick=" + encodeURIComponent(names[k])); } catch { /* inside a frame */ }
  }

  // The camera of the side that the reader touched last is that of both.
  function follow() {
    const [from, to] = [leader, sides.find((side) => side !== leader)].map((side) => side.viewer);
    const place = from.camera.position.toArray(), target = from.controls.target.toArray();
    if (String([to.camera.position.toArray(), to.controls.target.toArray()]) === String([place, target])) return;
    to.camera.position.set(...place);
    to.controls.target.set(...target);
    to.controls.update();
    to.set_dirty();
  }

  function open(title, k) {
    const section = document.createElement("section"), head = document.createElement("h2"), frame = document.createElement("iframe");
    head.textContent = frame.title = title;
    section.append(head, frame);
    byId("sides").append(section);
    return new Promise((done) => {
      frame.addEventListener("load", () => {
        frame.contentDocument?.body.classList.add("half");
        done(/** @type {any} */ (frame.contentWindow).pinproof);
      });
      frame.srcdoc = Object.entries(shared).reduce((page, [mark, block]) => page.replace(mark, () => block), pages[k]);
    });
  }

  function tick() {
    const now = performance.now();
    if (playing) {
      show(time + (now - before) / 1000);
      if (time >= duration) setPlaying(false);
    }
    before = now;
    follow();
    requestAnimationFrame(tick);
  }

  Promise.all(titles.map(open)).then((opened) => {
    sides = opened;
    leader = sides[0];
    for (const side of sides) for (const kind of ["pointerdown", "wheel", "keydown"]) {
      side.viewer.dom_element.ownerDocument.addEventListener(kind, () => { leader = side; }, true);
    }
    play.addEventListener("click", () => setPlaying(!playing));
    scrub.addEventListener("input", () => { setPlaying(false); show(Number(scrub.value)); });
    rows.forEach((row, k) => {
      row.addEventListener("click", () => chooseByReader(k));
      row.addEventListener("keydown", (event) => {
        const goal = { ArrowDown: k + 1, ArrowUp: k - 1, Home: 0, End: rows.length - 1, Enter: k, " ": k }[event.key];
        if (!(goal in rows)) return;
        event.preventDefault();
        chooseByReader(goal);
        rows[goal].focus();
      });
    });
    window.addEventListener("beforeprint", () => { for (const frame of document.querySelectorAll("iframe")) frame.contentWindow?.dispatchEvent(new Event("beforeprint")); });
    const stated = /(?:^#|&)pick=([^&]*)/.exec(location.hash);
    let linked = stated?.[1] ?? "";
    try { linked = decodeURIComponent(linked); } catch { /* the name as it is */ }
    if (rows.length) choose(Math.max(names.indexOf(linked), 0));
    tick();
    /** @type {any} */ (window).pinproof = { sides, choose: chooseByReader, show, ready: true, get chosen() { return chosen; }, get time() { return time; } };
  });
})();
