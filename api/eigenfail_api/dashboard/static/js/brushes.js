// What is drawn along an axis becomes conditions of the filter: the list follows, and the address.
const drawn = new WeakMap();
const FORM = "find";
const LIST = "#found";
const WHOLE = new Set(["steps"]);
const DIGITS = 4;

export function brushed(chart, { parallelAxisId: column, intervals }) {
  const form = document.getElementById(FORM);
  if (!form || !column) return;
  const known = drawn.get(chart) ?? new Map();
  drawn.set(chart, known);
  // The language has no or: the newest stretch of an axis takes the place of an older one.
  const newest = intervals.find((one) => !same(one, known.get(column))) ?? intervals[0];
  if (newest) known.set(column, newest);
  else known.delete(column);
  if (intervals.length > 1) {
    chart.dispatchAction({ type: "axisAreaSelect", parallelAxisId: column, intervals: [newest] });
    return;
  }
  narrow(form, [...known].flatMap(([name, interval]) => conditions(name, interval)));
}

function same(one, other) {
  return other !== undefined && one[0] === other[0] && one[1] === other[1];
}

function conditions(column, [low, high]) {
  const [from, to] = WHOLE.has(column)
    ? [Math.ceil(low), Math.floor(high)]
    : [Number(low.toPrecision(DIGITS)), Number(high.toPrecision(DIGITS))];
  return [`${column} >= ${from}`, `${column} <= ${to}`];
}

function narrow(form, more) {
  const filter = [form.dataset.base, ...more].filter(Boolean).join(" and ");
  form.elements.filter.value = filter;
  const address = new URL(window.location.href);
  address.searchParams.set("filter", filter);
  address.searchParams.delete("after");
  window.history.replaceState(null, "", address);
  window.htmx.ajax("GET", address.pathname + address.search, { target: LIST, select: LIST, swap: "outerHTML" });
}
