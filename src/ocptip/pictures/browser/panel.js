// Follows the slider of viser's player; what it does not find in the page it leaves alone.
(() => {
  const data = DATA, end = data.times[data.times.length - 1] || 1;
  const find = name => document.querySelector('#ocptip-panel ' + name);
  let last = -1, moved = 0, before = null;
  const nearest = time => data.times.reduce(
    (best, own, k) => Math.abs(own - time) < Math.abs(data.times[best] - time) ? k : best, 0);
  function follow() {
    const slider = document.querySelector('[role=slider]');
    if (slider) {
      const now = Number(slider.getAttribute('aria-valuenow'));
      if (now !== before) { before = now; moved = performance.now(); }
      const k = nearest(now);
      if (k !== last) {
        last = k;
        find('.ocptip-text').innerHTML = data.texts[k];
        const cursor = find('.ocptip-cursor'), x = data.wide * data.times[k] / end;
        cursor.setAttribute('x1', x);
        cursor.setAttribute('x2', x);
      }
    }
    requestAnimationFrame(follow);
  }
  function show(time) {
    const plays = performance.now() - moved < 250;
    const field = document.querySelector('input.mantine-NumberInput-input');
    if (!field) return;
    if (plays) field.parentElement.closest('div').parentElement.querySelector('button')?.click();
    const set = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set;
    set.call(field, time.toFixed(3));
    field.dispatchEvent(new Event('input', {bubbles: true}));
    field.dispatchEvent(new Event('change', {bubbles: true}));
  }
  find('.ocptip-worst').onclick = () => show(data.times[data.worst]);
  find('.ocptip-curve').onclick = event => {
    const box = find('.ocptip-curve').getBoundingClientRect();
    show(end * (event.clientX - box.left) / box.width);
  };
  follow();
})();
