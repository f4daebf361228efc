// Small multiples: a panel for each mode, all of one scale, two abreast where there is room.
const NARROW_PX = 620;
const PANEL_PX = 210;
const TOP_PX = 26;
const BOTTOM_PX = 56;

export const columnsOf = (panels, width) => (width < NARROW_PX || panels < 2 ? 1 : 2);

export const heightOf = (panels, columns, head = 0) => head + PANEL_PX * Math.ceil(panels / columns);

// Where a panel stands; `head` is the room above all of them, for a legend.
export function placeOf(panel, columns, head = 0) {
  const row = Math.floor(panel / columns);
  const across = columns === 1 ? { left: 74, right: 12 } : { left: panel % columns ? "58%" : 74, width: "36%" };
  return { ...across, top: head + TOP_PX + row * PANEL_PX, height: PANEL_PX - TOP_PX - BOTTOM_PX };
}

export function rangeOf(values) {
  return [Math.floor(Math.min(0, ...values)), Math.ceil(Math.max(0, ...values))];
}
