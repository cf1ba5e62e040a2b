// Unpacks the parts of the page, gives every module a name, and starts the viewer. A classic script: it runs
// before any module is loaded, so that it can still add the import map.
(async () => {
  "use strict";
  const bytesOf = (text) => Uint8Array.from(atob(text.trim()), (letter) => letter.charCodeAt(0));
  const inflate = (bytes) =>
    new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip")));
  const address = (parts) => URL.createObjectURL(new Blob(parts, { type: "text/javascript" }));

  const imports = {};
  const three = document.getElementById("three");
  imports.three = address([await inflate(bytesOf(three.textContent)).text()]);
  three.remove();
  for (const part of document.querySelectorAll("script[data-module]")) {
    imports[`live/${part.dataset.module}`] = address([part.textContent]);
  }
  const map = document.createElement("script");
  map.type = "importmap";
  map.textContent = JSON.stringify({ imports });
  document.head.append(map);

  const buffers = {};
  for (const part of document.querySelectorAll("script[data-channel]")) {
    buffers[part.dataset.channel] = await inflate(bytesOf(part.textContent)).arrayBuffer();
    part.remove();
  }
  const scene = JSON.parse(document.getElementById("scene").textContent);
  const { start } = await import("live/main");
  await start(scene, buffers);
  requestAnimationFrame(() => document.getElementById("loading").remove()); // after the first picture
})().catch((error) => {
  document.getElementById("loading")?.remove();
  const place = document.getElementById("failure");
  place.hidden = false;
  place.textContent = `This page cannot be shown: ${error.message}. It needs WebGL 2 and a browser of 2023 or newer.`;
  throw error;
});
