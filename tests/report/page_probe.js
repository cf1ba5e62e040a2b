// What a page of results shows: overflow, columns that can be reached, contrast of its words. A function
// body: its value is an object.
const root = document.documentElement;
for (const item of document.querySelectorAll("details")) item.open = true;
const box = (item) => item.getBoundingClientRect();
const shows = (item) => box(item).width > 0 && box(item).height > 0;

function channels(text) {
  const values = text.match(/-?[\d.]+(?:e-?\d+)?/g).map(Number);
  const scale = text.startsWith("color(") ? 255 : 1;
  return [values[0] * scale, values[1] * scale, values[2] * scale, values.length > 3 ? values[3] : 1];
}
function over(top, below) {
  return [0, 1, 2].map((k) => top[3] * top[k] + (1 - top[3]) * below[k]);
}
function luminance(rgb) {
  const [r, g, b] = rgb.map((v) => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}
function background(item) {
  const layers = [];
  for (let at = item; at; at = at.parentElement) layers.push(channels(getComputedStyle(at).backgroundColor));
  return layers.reduceRight((below, top) => over(top, below), [255, 255, 255]);
}
function contrast(item) {
  const style = getComputedStyle(item);
  const below = background(item);
  const word = over(channels(item.closest("svg") ? style.fill : style.color), below);
  const [a, b] = [luminance(word), luminance(below)].sort((x, y) => y - x);
  return (a + 0.05) / (b + 0.05);
}
const words = [...document.body.querySelectorAll("*")].filter((item) => shows(item)
  && [...item.childNodes].some((node) => node.nodeType === Node.TEXT_NODE && node.textContent.trim()));
const weak = [];
for (const item of words) {
  const style = getComputedStyle(item), size = parseFloat(style.fontSize);
  const large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
  const ratio = contrast(item);
  if (ratio < (large ? 3 : 4.5)) weak.push([item.textContent.trim().slice(0, 40), ratio]);
}
const hidden = [], unhinted = [], unnamed = [];
for (const table of document.querySelectorAll("main table")) {
  const scroll = table.closest(".scroll"), first = table.rows[0]?.textContent.trim().slice(0, 40);
  const isCards = getComputedStyle(table).display === "block";
  const scrolls = scroll && scroll.scrollWidth > scroll.clientWidth + 1 && getComputedStyle(scroll).overflowX === "auto";
  if (scrolls) {
    const hint = scroll.parentElement.querySelector(":scope > .swipe");
    if (!hint || !shows(hint)) unhinted.push(first);
    scroll.scrollLeft = scroll.scrollWidth;
  }
  const [left, right] = scroll ? [box(scroll).left, box(scroll).right] : [0, root.clientWidth];
  for (const cell of table.querySelectorAll(isCards ? "tbody td" : "td, thead th")) {
    const start = box(cell).left + (scrolls ? scroll.scrollLeft : 0);
    const reachable = box(cell).width > 0 && box(cell).right <= right + 1.5 && start >= left - 1.5;
    if (!reachable && getComputedStyle(cell.closest("tr")).display !== "none" && !cell.closest(".summary thead")) hidden.push(cell.textContent.trim().slice(0, 40));
    if (isCards && cell.dataset.head && !getComputedStyle(cell, "::before").content.includes(cell.dataset.head.slice(0, 3))) unnamed.push(cell.dataset.head);
  }
}
// Names and numbers of tables that stand on more than one line
const broken = new Set();
for (const cell of document.querySelectorAll("main td, main th")) {
  const texts = document.createTreeWalker(cell, NodeFilter.SHOW_TEXT), range = document.createRange();
  for (let text = texts.nextNode(); text; text = texts.nextNode()) {
    for (const { 0: word, index } of text.data.matchAll(/[\w.]+/g)) {
      range.setStart(text, index);
      range.setEnd(text, index + word.length);
      if (new Set([...range.getClientRects()].map(({ top }) => Math.round(top))).size > 1) broken.add(word);
    }
  }
}
const pictures = [...document.querySelectorAll("figure svg, figure img")];
return {
  title: document.title,
  heading: document.querySelector("h1").textContent,
  overflow: root.scrollWidth - window.innerWidth,
  words: words.length,
  weak: weak.slice(0, 10),
  hidden: [...new Set(hidden)].slice(0, 10),
  unhinted: unhinted.slice(0, 5),
  unnamed: [...new Set(unnamed)].slice(0, 5),
  broken: [...broken].slice(0, 5),
  unseen: pictures.filter((item) => !shows(item)).length,
  paper: luminance(background(document.body)),
  lost: [...document.images].filter((item) => !item.complete || !item.naturalWidth).length,
};
