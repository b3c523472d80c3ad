// What the page makes of a run's messages at every moment of it: what it asks, and where it shows the answers.
// node --import ./tests/web/import_map.js tests/web/shown_moments.js RUN.json
import { readFileSync } from "node:fs";
import { answeredBy, receive, setView, state } from "../../verefine_viz/page/web/store.js";
import "../../verefine_viz/page/web/received.js";
import { momentOf } from "../../verefine_viz/page/web/moment.js";
import { cropsOf, landscapeOf, mapsOf, physicsOf } from "../../verefine_viz/page/web/wants.js";

answeredBy({ send: () => true, load: () => Promise.resolve(null), address: (path) => path });
const { messages } = JSON.parse(readFileSync(process.argv[2], "utf-8"));
messages.forEach(receive);

const asked = [];
const shown = [];
for (const { index } of state.branches) {
  const { rows } = state.runs.get(index);
  for (const { id } of state.frame.objects) {
    for (let k = 1; k <= rows.length; k++) {
      const own = rows[k - 1].obj === id;
      const stages = own ? rows[k - 1].stages.map((stage) => stage.name) : [];
      for (const stage of [null, ...stages]) {
        setView({ branch: index, k, obj: id, stage, arm: null, a: null, b: null });
        const m = momentOf(state);
        if (!own && !m.isAnswer) continue;
        asked.push(...[m.a, m.b].filter(Boolean).map((pose) => mapsOf(m, pose)), physicsOf(state, m), cropsOf(m));
        if (m.isAnswer) asked.push(...["curves", "other"].map((part) => ({ ...landscapeOf(m), part })));
        shown.push({ branch: index, obj: id, k, stage: m.stage, isAnswer: m.isAnswer, isPartial: m.isPartial,
          poses: Object.fromEntries(Object.entries(m.poses).map(([name, pose]) => [name, pose.T])),
          stands: m.scene.find((o) => o.object.id === id).T });
      }
    }
  }
}
process.stdout.write(JSON.stringify({ asked, shown }));
