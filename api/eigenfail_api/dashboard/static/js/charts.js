// Finds the charts of a page and draws each from the values in its data attribute.
import { isForPaper, onThemeChange } from "./theme.js";

const drawn = new WeakMap();
// A scroll bar that comes or goes changes no layout; a window that became narrow does.
const RELAID_PX = 40;
const resized = new ResizeObserver((entries) => {
  const plots = entries.map(({ target }) => target);
  const relaid = plots.filter(isOfAnotherWidth);
  for (const plot of plots) fit(window.echarts.getInstanceByDom(plot), sizeOf(plot));
  for (const plot of relaid) drawn.delete(plot);
  draw(relaid.map((plot) => plot.closest("figure")));
});
const MARGIN_PX = 200;
const seen = new IntersectionObserver((entries) => {
  draw(entries.filter((entry) => entry.isIntersecting).map((entry) => entry.target.closest("figure")));
}, { rootMargin: `${MARGIN_PX}px` });

let kinds = {};
let arm = () => {};

// The kinds of charts that a page has: options from values and a width; and what is done once to each.
export function startCharts(known, armed = arm) {
  kinds = known;
  arm = armed;
  drawAll();
  document.addEventListener("htmx:after:swap", drawAll);
}

function drawAll() {
  for (const figure of figures()) seen.observe(plotOf(figure));
  // The observer tells of what comes into view later. What is in view already is drawn now, before
  // the browser paints a frame without it; what is drawn already may have new values.
  const due = [...figures()].filter((figure) => isInView(plotOf(figure)) || window.echarts.getInstanceByDom(plotOf(figure)));
  draw(due);
}

// As the observer sees it: what is not displayed has no height.
function isInView(plot) {
  const { top, bottom, height } = plot.getBoundingClientRect();
  return height > 0 && bottom > -MARGIN_PX && top < window.innerHeight + MARGIN_PX;
}

onThemeChange(() => {
  for (const figure of figures()) drawn.delete(plotOf(figure));
  // A print shows what has not been scrolled to, too.
  draw([...figures()].filter((figure) => isForPaper() || window.echarts.getInstanceByDom(plotOf(figure))));
});

function figures() {
  return document.querySelectorAll("figure[data-chart]");
}

function plotOf(figure) {
  return figure.querySelector(".plot");
}

function isOfAnotherWidth(plot) {
  const before = window.echarts.getInstanceByDom(plot)?.getWidth();
  return !isForPaper() && plot.clientWidth > 0 && Math.abs(plot.clientWidth - before) > RELAID_PX;
}

function sizeOf(plot) {
  return { width: plot.clientWidth, height: plot.clientHeight };
}

// All sizes are read before the first chart is drawn: after each, the browser would have to lay out
// the whole page again to tell the next one.
function draw(due) {
  const { fontFamily } = getComputedStyle(document.body);
  const sizes = due.map((figure) => sizeOf(plotOf(figure)));
  due.forEach((figure, position) => drawOne(figure, sizes[position], fontFamily));
}

function drawOne(figure, { width, height: before }, fontFamily) {
  const plot = plotOf(figure);
  if (drawn.get(plot) === figure.dataset.values) return;
  drawn.set(plot, figure.dataset.values);
  const { height = before, ...option } = kinds[figure.dataset.chart](valuesOf(figure), width);
  if (height !== before) plot.style.height = `${height}px`;
  const chart = window.echarts.getInstanceByDom(plot) ?? create(plot, figure, { width, height });
  fit(chart, { width, height });
  chart.setOption({ animation: false, textStyle: { fontFamily }, ...option }, { notMerge: true });
}

const whole = new WeakSet();

// Of many channels the most influential ones are drawn, which come first, until somebody wants all.
function valuesOf(figure) {
  const values = JSON.parse(figure.dataset.values);
  const button = figure.querySelector("[data-channels]");
  if (!button || whole.has(button)) return values;
  const first = Object.entries(values.channels).slice(0, Number(button.dataset.channels));
  return { ...values, channels: Object.fromEntries(first) };
}

document.addEventListener("click", ({ target }) => {
  const button = target.closest?.("[data-channels]");
  if (!button) return;
  if (!whole.delete(button)) whole.add(button);
  [button.textContent, button.dataset.fewer] = [button.dataset.fewer, button.textContent];
  const figure = button.closest("figure");
  drawn.delete(plotOf(figure));
  draw([figure]);
});

// The observer's first word is of the size that the chart was drawn at. On paper the style sheet fits it.
function fit(chart, { width, height }) {
  if (chart && !isForPaper() && (chart.getWidth() !== width || chart.getHeight() !== height)) chart.resize({ width, height });
}

function create(plot, figure, size) {
  const chart = window.echarts.init(plot, null, size);
  resized.observe(plot);
  chart.on("click", (event) => {
    const target = event.data?.link ?? event.value?.[2];
    if (figure.dataset.link && target !== undefined) window.location.assign(figure.dataset.link + target);
  });
  arm(chart);
  return chart;
}
