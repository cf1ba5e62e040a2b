// Texts and diagrams change a few times a second: nobody reads faster, and each change is drawn anew.

/** Return a function that calls `call` at once, then at most every `interval` ms; the last request is always served.
    `isUrgent` lets a request through at any time. */
export function pace(call, interval) {
  let last = -Infinity;
  let timer = null;
  const serve = () => {
    clearTimeout(timer);
    timer = null;
    last = performance.now();
    call();
  };
  return (isUrgent = false) => {
    const wait = last + interval - performance.now();
    if (isUrgent || wait <= 0) serve();
    else timer ??= setTimeout(serve, wait);
  };
}
