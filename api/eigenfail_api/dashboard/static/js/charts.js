// Finds the charts of a page and draws each from the values in its data attribute.
import { cost } from "./charts_cost.js";
import { curve, likelihood, robustness } from "./charts_campaign.js";
import { eigenfailures, explained, influence, scores } from "./charts_analysis.js";
import { noise } from "./charts_noise.js";
import { bills, spending } from "./charts_spending.js";
import { training } from "./charts_training.js";
import { onThemeChange } from "./theme.js";

const KINDS = { bills, cost, curve, eigenfailures, explained, influence, likelihood, noise, robustness, scores, spending, training };

const drawn = new WeakMap();
const resized = new ResizeObserver((entries) => {
  for (const entry of entries) window.echarts.getInstanceByDom(entry.target)?.resize();
});
const seen = new IntersectionObserver((entries) => {
  for (const entry of entries) if (entry.isIntersecting) draw(entry.target.parentElement);
}, { rootMargin: "200px" });

export function drawAll() {
  for (const figure of figures()) seen.observe(plotOf(figure));
  // The observer tells of what comes into view; what is in view already may have new values.
  for (const figure of figures()) if (window.echarts.getInstanceByDom(plotOf(figure))) draw(figure);
}

onThemeChange(() => {
  for (const figure of figures()) {
    drawn.delete(plotOf(figure));
    if (window.echarts.getInstanceByDom(plotOf(figure))) draw(figure);
  }
});

function figures() {
  return [...document.querySelectorAll("figure[data-chart]")].filter((one) => one.dataset.chart in KINDS);
}

function plotOf(figure) {
  return figure.querySelector(".plot");
}

function draw(figure) {
  const plot = plotOf(figure);
  if (drawn.get(plot) === figure.dataset.values) return;
  drawn.set(plot, figure.dataset.values);
  const values = JSON.parse(figure.dataset.values);
  const { height, ...option } = KINDS[figure.dataset.chart](values, plot.clientWidth);
  if (height) plot.style.height = `${height}px`;
  const chart = window.echarts.getInstanceByDom(plot) ?? create(plot, figure);
  chart.resize();
  chart.setOption({ animation: false, textStyle: { fontFamily: getComputedStyle(document.body).fontFamily }, ...option }, { notMerge: true });
}

function create(plot, figure) {
  const chart = window.echarts.init(plot);
  resized.observe(plot);
  chart.on("click", (event) => {
    const target = event.data?.link ?? event.value?.[2];
    if (figure.dataset.link && target !== undefined) window.location.assign(figure.dataset.link + target);
  });
  return chart;
}
