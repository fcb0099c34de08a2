// What the page orders of the Rerun viewer: each is a function of its WebViewer, and an answer comes with the viewer's next
// frame. It fails where what it is about is not there (yet).
const STAGE = "stage"; // timeline of the recordings: the serial number of the message that was taken in last
const FRAMES = "exposure"; // timeline of the frames, in recordings that hold them all

// Has a recording drawn again. All that is drawn is static: the time cursor, which is put to its beginning, changes nothing.
export const redraw = (recording) => (web) => web.set_time({ recording, timeline: STAGE, sequence: 0, play_state: "paused" });

// Shows a frame of a recording that has all of them.
export const showFrame = (recording, index) => (web) =>
  web.set_time({ recording, timeline: FRAMES, sequence: index, play_state: "paused" });

// Of all recordings but this one; what the viewer holds of them is memory for nothing.
export const closeOthers = (recording) => async (web) => {
  const { recordings } = await web.get_state();
  const others = recordings.map(({ store_id }) => store_id).filter((id) => id !== recording);
  if (others.length) await web.close({ store_ids: others });
};

// Changes these components of the layout that a recording is shown in, and nothing else. A layout is read and written as a
// whole, so one change waits for the other.
let changed = Promise.resolve();
export const updateBlueprint = (recording, entities) => (web) => {
  const change = async () => {
    const target = { kind: "recording", recording };
    const { blueprint } = await web.get_blueprint(target);
    for (const [path, archetypes] of Object.entries(entities))
      for (const [name, components] of Object.entries(archetypes)) {
        blueprint[path] ??= {};
        blueprint[path][name] = { ...blueprint[path][name], ...components };
      }
    await web.set_blueprint(blueprint, target);
  };
  changed = changed.then(change, change);
  return changed;
};

// The serial number of the message that a recording took in last; null where the viewer does not have it. get_state would say
// it, too, but has the viewer draw a frame each time: with software graphics an idle page would never rest.
export const serialOf = (web, recording) => web.get_time_range(recordingOf(recording), STAGE)?.max ?? null;

// Whether the viewer shows this recording.
export const isActive = (web, recording) => web.get_active_recording_id() === recordingOf(recording);

// Whether it shows another one, which somebody opened in it.
export const showsAnother = (web, recording) => ![null, recordingOf(recording)].includes(web.get_active_recording_id());

const recordingOf = (id) => id.split(":").at(-1);
