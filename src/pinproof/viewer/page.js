// The page of one motion, which may be live: the server it came from then sends further commands.
offer(settings.duration);

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
