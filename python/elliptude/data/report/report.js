"use strict";
(function () {
  const data = JSON.parse(document.getElementById("data").textContent);
  const config = { responsive: true, displaylogo: false, displayModeBar: false, scrollZoom: false };
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const element = (id) => document.getElementById(id);

  function ink() {
    return getComputedStyle(document.documentElement).getPropertyValue("--ink").trim();
  }

  // Lines whose meta is "ink" are black on white, or white on black.
  function colour(id) {
    const plot = element(id);
    if (!plot.data) { return; }
    const inked = plot.data.map((trace, i) => (trace.meta === "ink" ? i : -1)).filter((i) => i >= 0);
    const grid = dark.matches ? "#3a3d44" : "#e0e0e0";
    const change = { "font.color": ink() };
    for (const name of Object.keys(plot.layout)) {
      if (/^[xy]axis\d*$/.test(name)) {
        change[name + ".gridcolor"] = grid;
        change[name + ".zerolinecolor"] = grid;
      }
    }
    Plotly.relayout(plot, change);
    if (inked.length) { Plotly.restyle(plot, { "line.color": ink(), "marker.color": ink() }, inked); }
  }

  // --- the sphere: patches are 16-bit numbers, frames x axes x vertices x 3 ---
  function decode(text) {
    const raw = atob(text);
    const bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i += 1) { bytes[i] = raw.charCodeAt(i); }
    const view = new DataView(bytes.buffer);
    const numbers = new Array(bytes.length / 2);
    for (let i = 0; i < numbers.length; i += 1) {
      const value = view.getInt16(2 * i, true);
      numbers[i] = value === -32768 ? null : value / 32767;
    }
    return numbers;
  }

  const frames = data.frames;
  const patches = decode(frames.patches);
  const tips = decode(frames.tips);
  const marks = frames.marks === null ? null : decode(frames.marks);

  function points(numbers, first, count, radius) {
    const columns = { x: [], y: [], z: [] };
    for (let i = 0; i < count; i += 1) {
      ["x", "y", "z"].forEach((name, j) => {
        const value = numbers[3 * (first + i) + j];
        columns[name].push(value === null ? null : radius * value);
      });
    }
    return columns;
  }

  function show(frame) {
    const vertices = frames.vertices;
    const update = { x: [], y: [], z: [] };
    const add = (columns) => { for (const name of ["x", "y", "z"]) { update[name].push(columns[name]); } };
    for (let axis = 0; axis < 3; axis += 1) {
      const patch = points(patches, (3 * frame + axis) * vertices, vertices, 1.004);
      // A mesh with empty vertices is an error for WebGL: no patch is one without extent inside the sphere.
      if (patch.x[0] === null) { for (const name of ["x", "y", "z"]) { patch[name].fill(0); } }
      add(patch);
    }
    for (let axis = 0; axis < 3; axis += 1) {
      const rim = points(patches, (3 * frame + axis) * vertices, frames.meridians, 1.008);
      for (const name of ["x", "y", "z"]) { rim[name].push(rim[name][0]); }
      add(rim);
    }
    for (let axis = 0; axis < 3; axis += 1) {
      const tip = points(tips, 3 * frame + axis, 1, 1);
      add({ x: [tip.x[0], tip.x[0] && 1.3 * tip.x[0]], y: [tip.y[0], tip.y[0] && 1.3 * tip.y[0]],
            z: [tip.z[0], tip.z[0] && 1.3 * tip.z[0]] });
    }
    const moved = frames.patch_traces.concat(frames.rim_traces, frames.tip_traces);
    if (marks !== null) {
      add(points(marks, 3 * frame, 3, 1.03));
      moved.push(frames.mark_trace);
    }
    element("now").textContent = frames.labels[frame];
    element("time").setAttribute("aria-valuetext", frames.labels[frame]);
    return Plotly.restyle("sphere", update, moved);
  }

  const slider = element("time");
  const button = element("play");
  let isPlaying = false;
  let isDrawing = false;
  let isStale = false;

  // One drawing at a time; the last wish counts.
  function draw() {
    if (isDrawing) { isStale = true; return; }
    isDrawing = true;
    show(Number(slider.value)).then(() => {
      isDrawing = false;
      if (isStale) { isStale = false; draw(); }
    });
  }

  function step() {
    if (!isPlaying) { return; }
    if (Number(slider.value) >= Number(slider.max)) { play(false); return; }
    if (!isDrawing) {
      slider.value = String(Number(slider.value) + 1);
      draw();
    }
    window.setTimeout(step, 80);
  }

  function play(wanted) {
    isPlaying = wanted;
    button.textContent = wanted ? "Pause" : "Play";
    button.setAttribute("aria-pressed", String(wanted));
    if (wanted) {
      if (Number(slider.value) >= Number(slider.max)) { slider.value = "0"; }
      step();
    }
  }

  slider.max = String(frames.labels.length - 1);
  slider.addEventListener("input", draw);
  button.addEventListener("click", () => play(!isPlaying));

  const names = Object.keys(data.plots);
  const drawn = names.map((id) => Plotly.newPlot(id, data.plots[id].data, data.plots[id].layout, config));
  Promise.all(drawn).then(() => show(0)).then(() => {
    names.forEach(colour);
    document.documentElement.dataset.ready = "true";
  });
  dark.addEventListener("change", () => names.forEach(colour));
}());
