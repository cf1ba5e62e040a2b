// The worker as the page uses it: orders, and the last state that it reported.

/** Start the worker; `changed(state)` is called with each state that it reports. */
export async function startEngine(described, bytes, source, changed) {
  const address = URL.createObjectURL(new Blob([source], { type: "text/javascript" }));
  const worker = new Worker(address);
  const waiting = new Map();
  let number = 0;
  const engine = { described, last: null, failure: "" };
  worker.onmessage = ({ data }) => {
    const [done, refuse] = waiting.get(data.answer) ?? [];
    waiting.delete(data.answer);
    if (data.refused) {
      refuse?.(new RangeError(data.refused));
      return;
    }
    engine.last = data;
    changed(data);
    done?.(data);
  };
  worker.onerror = (event) => {
    engine.failure = event.message || "the worker failed";
    changed(engine.last);
  };
  engine.send = (order, more = {}) => worker.postMessage({ order, ...more });
  /** Send an order and return a promise of the state after it, which is rejected where the order is refused. */
  engine.ask = (order, more = {}) =>
    new Promise((done, refuse) => {
      number += 1;
      waiting.set(number, [done, refuse]);
      worker.postMessage({ order, answer: number, ...more });
    });
  await engine.ask("build", { engine: described, bytes });
  return engine;
}
