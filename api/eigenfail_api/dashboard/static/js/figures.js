// Figures of the player and the charts, written as the rest of the page writes them.
export const signed = (text) => text.replace(/^-/, "−");

// A fixed number of decimals; what rounds to zero has no sign.
export function fixed(value, decimals = 1) {
  const text = value.toFixed(decimals);
  return Number(text) === 0 ? (0).toFixed(decimals) : signed(text);
}
