// The page of one motion. A live page receives further commands from the server that sent it.
offer(settings.duration, settings.start, settings.parameter);

const moment = byId("moment");
moment.hidden = settings.start === null;
moment.addEventListener("click", () => seek(settings.start));
if (/(?:^#|&)still\b/.test(location.hash)) document.body.classList.add("still");
viewer.set_3d_pane_size();
// write_png waits for this message, which follows a completely drawn frame.
pictured.then(() => requestAnimationFrame(() => requestAnimationFrame(() => console.info("pinproof: drawn"))));

// The plots have a line at the current time; a click seeks to a time.
const plots = byId("plots");
if (plots) {
  const places = [...plots.querySelectorAll("svg")].map((svg) => {
    const left = Number(svg.dataset.left), width = svg.viewBox.baseVal.width;
    return { svg, left, width, span: width - left - Number(svg.dataset.right), now: svg.querySelector(".now") };
  });
  const follow = () => {
    const share = Math.min(Math.max(animator.time / settings.duration, 0), 1);
    for (const { now, span } of places) now.setAttribute("transform", `translate(${(share * span).toFixed(1)} 0)`);
    if (plots.open) requestAnimationFrame(follow);
  };
  plots.addEventListener("toggle", () => {
    viewer.set_3d_pane_size();
    follow();
  });
  for (const { svg, left, width, span } of places) {
    svg.addEventListener("click", (event) => {
      const box = svg.getBoundingClientRect();
      seek((((event.clientX - box.left) / box.width) * width - left) / span * settings.duration);
    });
  }
}

// The browser reconnects by itself after the connection is lost. If the identifier of the page has changed, it reloads.
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

window.pinproof = { viewer, seek, setLayer, settings, pictured, events: source, ready: true };
