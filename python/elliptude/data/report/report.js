"use strict";
(function () {
  const data = JSON.parse(document.getElementById("data").textContent);
  const config = { responsive: true, displaylogo: false, displayModeBar: false, scrollZoom: false };
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const element = (id) => document.getElementById(id);

  function ink() {
    return getComputedStyle(document.documentElement).getPropertyValue("--ink").trim();
  }

  // A blue that is dark enough for white paper cannot be read on black.
  const ON_BLACK = { "#0072B2": "#56B4E9", "rgba(0,114,178,0.22)": "rgba(86,180,233,0.3)" };
  const names = Object.keys(data.plots);
  const onWhite = Object.fromEntries(names.map((id) => [id, data.plots[id].data.map((trace) => ({
    "line.color": trace.line && trace.line.color,
    "fillcolor": trace.fillcolor,
    "color": trace.type === "mesh3d" ? trace.color : undefined,
    "textfont.color": trace.textfont && trace.textfont.color,
  }))]));

  function recolour(plot, id) {
    onWhite[id].forEach((colours, i) => {
      if (plot.data[i].type === "surface") {
        // Names in white cannot be read on a light globe.
        const globe = dark.matches ? "#4a4f58" : "#d8dbe0";
        Plotly.restyle(plot, { colorscale: [[[0, globe], [1, globe]]] }, [i]);
      }
      const known = Object.entries(colours).filter(([, value]) => value in ON_BLACK);
      const change = known.map(([key, value]) => [key, dark.matches ? ON_BLACK[value] : value]);
      if (change.length) { Plotly.restyle(plot, Object.fromEntries(change), [i]); }
    });
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
    recolour(plot, id);
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

  // --- measurements left out, one by one ---
  const each = data.dropped;
  const MOST_SHOWN = 500;

  function listEach() {
    const columns = [["time", "time s"], ["place", "place in the log"], ["sensor", "sensor"], ["why", "contradicts"],
                     ["margin", "margin"]];
    const chosen = element("each-sensor");
    for (const name of ["all", ...Array.from(new Set(each.sensor)).sort()]) { chosen.add(new Option(name, name)); }
    let by = "time";
    let isDown = false;

    function cell(row, name) {
      const td = document.createElement("td");
      if (name === "time") {
        const go = document.createElement("button");
        go.type = "button";
        go.className = "plain";
        go.textContent = String(each.time[row]);
        go.addEventListener("click", () => goTo(each.time[row]));
        td.append(go);
      } else {
        td.textContent = name === "margin" ? (each.margin[row] + " " + each.unit[row]).trim() : each[name][row];
      }
      return td;
    }

    // "line 9" is before "line 10".
    const order = new Intl.Collator("en", { numeric: true });
    function compare(a, b) {
      const one = each[by][a];
      const other = each[by][b];
      return (isDown ? -1 : 1) * (typeof one === "number" ? one - other : order.compare(one, other));
    }

    function fill() {
      const rows = each.time.map((_, row) => row)
        .filter((row) => chosen.selectedIndex === 0 || each.sensor[row] === chosen.value).sort(compare);
      const shown = rows.slice(0, MOST_SHOWN);
      element("each-table").tBodies[0].replaceChildren(...shown.map((row) => {
        const tr = document.createElement("tr");
        tr.append(...columns.map(([name]) => cell(row, name)));
        return tr;
      }));
      let text = rows.length + (rows.length === 1 ? " measurement" : " measurements");
      if (shown.length < rows.length) { text += ", the first " + shown.length + " in this order are shown"; }
      if (each.time.length < each.total) {
        text += "; of " + each.total + " in all, those farthest off: see dropped.csv for the others";
      }
      element("each-count").textContent = text;
      heads.forEach(({ th, name }) => {
        th.setAttribute("aria-sort", name !== by ? "none" : isDown ? "descending" : "ascending");
      });
    }

    const heads = columns.map(([name, text]) => {
      const th = document.createElement("th");
      const sort = document.createElement("button");
      th.scope = "col";
      sort.type = "button";
      sort.className = "plain";
      sort.textContent = text;
      sort.addEventListener("click", () => {
        isDown = name === by && !isDown;
        by = name;
        fill();
      });
      th.append(sort);
      return { th, name };
    });
    const line = document.createElement("tr");
    line.append(...heads.map(({ th }) => th));
    element("each-table").tHead.append(line);
    chosen.addEventListener("change", fill);
    fill();
  }

  // The sphere's time that is nearest.
  function goTo(time) {
    const far = frames.times.map((at) => Math.abs(at - time));
    slider.value = String(far.indexOf(Math.min(...far)));
    draw();
    element("h-sphere").scrollIntoView();
  }

  if (each !== null) { listEach(); }

  slider.max = String(frames.labels.length - 1);
  slider.value = String(frames.opens_at);
  slider.addEventListener("input", draw);
  button.addEventListener("click", () => play(!isPlaying));

  const drawn = names.map((id) => Plotly.newPlot(id, data.plots[id].data, data.plots[id].layout, config));
  Promise.all(drawn).then(() => show(0)).then(() => {
    names.forEach(colour);
    document.documentElement.dataset.ready = "true";
  });
  dark.addEventListener("change", () => names.forEach(colour));
}());
