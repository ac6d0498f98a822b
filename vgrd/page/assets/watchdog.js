// Greys the page when anything between the registers and this screen stands still: a frozen server cannot say so.
"use strict";
(() => {
  const STALE_MS = 800; // as STALE_S of vgrd/page/link.py
  const ASK_MS = 100;
  let freshUntil = 0;
  let serverAhead = 0; // the server's clock minus ours, ms
  const noLink = document.createElement("div");
  noLink.id = "no-link";
  noLink.setAttribute("role", "alert");
  noLink.textContent = document.documentElement.dataset.noLink;

  async function ask() {
    const sent = performance.now();
    try {
      const reply = await fetch("pulse", { cache: "no-store", signal: AbortSignal.timeout(STALE_MS) });
      const pulse = await reply.json();
      serverAhead = pulse.now_ms - performance.now(); // by the way back too little: presses look older, never newer
      // The pulse comes by another way than all that is shown: that must have come just now, too.
      const shown_ms = Number(document.getElementById("version")?.dataset.shown);
      const until = sent + STALE_MS - Math.max(pulse.age_ms, pulse.now_ms - shown_ms);
      if (reply.ok && until > freshUntil) freshUntil = until; // never where nothing was shown yet: NaN
    } catch { /* no answer is what this is made for: freshUntil passes */ }
    setTimeout(ask, ASK_MS);
  }

  // What a button was pressed at, and what it takes from the page, for the server to judge.
  const shown = part => [part.dataset.fact, part.querySelector("input")?.value ?? part.textContent];
  window.vgrdSeen = () => JSON.stringify([
    document.getElementById("version").textContent, performance.now() + serverAhead,
    Object.fromEntries([...document.querySelectorAll("[data-fact]")].map(shown)),
  ]);

  function show() {
    if (!noLink.isConnected) document.body.append(noLink);
    const stale = performance.now() > freshUntil;
    if (document.body.classList.contains("stale") === stale) return;
    document.body.classList.toggle("stale", stale);
    for (const part of document.body.children) if (part !== noLink) part.inert = stale;
  }

  async function look() {
    const image = [...document.querySelectorAll(".live")].find(one => one.offsetParent);
    if (!image) { setTimeout(look, 300); return; }
    try {
      const reply = await fetch(`frame?after=${image.dataset.frame || -1}`, { cache: "no-store", signal: AbortSignal.timeout(3000) });
      if (reply.status === 200) draw(image, await reply.blob(), JSON.parse(reply.headers.get("X-Facts")));
      if (reply.status >= 400) await new Promise(done => setTimeout(done, 500));
    } catch { await new Promise(done => setTimeout(done, 500)); }
    setTimeout(look, 0);
  }

  function draw(image, blob, facts) {
    const old = image.src;
    image.onload = () => {
      if (old.startsWith("blob:")) URL.revokeObjectURL(old);
      image.dataset.shown = Date.now();
    };
    image.src = URL.createObjectURL(blob);
    image.dataset.frame = facts.frame;
    image.dataset.taken = 1000 * facts.taken_unix_s;
    image.dataset.since = performance.now() - facts.age_ms; // by our clock: that of a tablet may be wrong
    image.dataset.old = facts.old_ms;
    image.dataset.words = facts.words;
    const marks = image.nextElementSibling;
    marks.setAttribute("viewBox", `0 0 ${facts.width_px} ${facts.height_px}`);
    marks.replaceChildren(...Object.entries(facts.tags).flatMap(([name, tag]) => mark(name, tag)));
    date();
  }

  // A picture that no other one follows is of then: so are its marks, and the words about it.
  function date() {
    for (const image of document.querySelectorAll(".live[data-since]")) {
      const age_ms = performance.now() - image.dataset.since, isOld = age_ms > image.dataset.old;
      const words = isOld ? document.documentElement.dataset.oldPicture.replace("{seconds}", Math.round(age_ms / 1000)) : image.dataset.words;
      const label = image.parentElement.nextElementSibling;
      image.parentElement.classList.toggle("old", isOld);
      if (label.textContent !== words) label.textContent = words;
    }
  }

  function mark(name, tag) {
    if (!tag.corners) return [];
    const shape = document.createElementNS("http://www.w3.org/2000/svg", "polygon");
    shape.setAttribute("points", tag.corners.map(corner => corner.join(",")).join(" "));
    const label = document.createElementNS("http://www.w3.org/2000/svg", "text");
    label.setAttribute("x", tag.corners[0][0]);
    label.setAttribute("y", tag.corners[0][1] - 8);
    label.textContent = name.toUpperCase();
    return [shape, label];
  }

  // A table that is wider than the screen scrolls: the keyboard must reach it.
  function reach() {
    for (const part of document.querySelectorAll(".q-table__middle:not([tabindex])")) part.tabIndex = 0;
  }

  addEventListener("DOMContentLoaded", () => { ask(); look(); setInterval(show, 50); setInterval(date, 200); setInterval(reach, 300); });
})();
