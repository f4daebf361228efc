// Finds the charts of a page and draws each from the values in its data attribute.
import { isForPaper, onThemeChange } from "./theme.js";

const drawn = new WeakMap();
const resized = new ResizeObserver((entries) => {
  for (const { target } of entries) fit(target, window.echarts.getInstanceByDom(target));
});
const MARGIN_PX = 200;
const seen = new IntersectionObserver((entries) => {
  for (const entry of entries) if (entry.isIntersecting) draw(entry.target.closest("figure"));
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
  due.forEach(draw);
}

// As the observer sees it: what is not displayed has no height.
function isInView(plot) {
  const { top, bottom, height } = plot.getBoundingClientRect();
  return height > 0 && bottom > -MARGIN_PX && top < window.innerHeight + MARGIN_PX;
}

onThemeChange(() => {
  for (const figure of figures()) {
    drawn.delete(plotOf(figure));
    // A print shows what has not been scrolled to, too.
    if (isForPaper() || window.echarts.getInstanceByDom(plotOf(figure))) draw(figure);
  }
});

function figures() {
  return document.querySelectorAll("figure[data-chart]");
}

function plotOf(figure) {
  return figure.querySelector(".plot");
}

function draw(figure) {
  const plot = plotOf(figure);
  if (drawn.get(plot) === figure.dataset.values) return;
  drawn.set(plot, figure.dataset.values);
  const values = JSON.parse(figure.dataset.values);
  const { height, ...option } = kinds[figure.dataset.chart](values, plot.clientWidth);
  if (height) plot.style.height = `${height}px`;
  const chart = window.echarts.getInstanceByDom(plot) ?? create(plot, figure);
  fit(plot, chart);
  chart.setOption({ animation: false, textStyle: { fontFamily: getComputedStyle(document.body).fontFamily }, ...option }, { notMerge: true });
}

// The observer's first word is of the size that the chart was drawn at. On paper the style sheet fits it.
function fit(plot, chart) {
  if (chart && !isForPaper() && (chart.getWidth() !== plot.clientWidth || chart.getHeight() !== plot.clientHeight)) chart.resize();
}

function create(plot, figure) {
  const chart = window.echarts.init(plot);
  resized.observe(plot);
  chart.on("click", (event) => {
    const target = event.data?.link ?? event.value?.[2];
    if (figure.dataset.link && target !== undefined) window.location.assign(figure.dataset.link + target);
  });
  arm(chart);
  return chart;
}
