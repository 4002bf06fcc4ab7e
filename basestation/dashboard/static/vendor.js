/** The libraries of others, which index.html loads before the modules, or null when they are not installed. */

const loaded = /** @type {{MessagePack?: typeof import("@msgpack/msgpack"), uPlot?: typeof import("uplot")}} */ (
  /** @type {unknown} */ (globalThis)
);

export const messagePack = loaded.MessagePack ?? null;
export const uPlot = loaded.uPlot ?? null;
