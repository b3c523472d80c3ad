// Written by `make messages` from verefine_viz/page/messages.py and protocol.py: change those.

/** T_cam_obj, 16 numbers by rows [m]. */
export type Pose = number[];

export type AnyMessage =
  | HelloMessage
  | FileMessage
  | FrameMessage
  | BranchesMessage
  | RunMessage
  | VerdictMessage
  | ReadyMessage
  | DoubtsMessage
  | BusyMessage
  | RunningMessage
  | NoteMessage
  | ErrorMessage
  | WrittenMessage
  | EditedMessage
  | PickedMessage
  | Scene3DMessage
  | ViewMessage
  | BreakpointsMessage
  | AnswerMessage
  | AnswersMessage
  | ReportMessage
  | LabelsMessage
  | FixMessage;

/** The first after a connection; a page that meets another version reloads itself. */
export interface HelloMessage {
  t: "hello";
  /** Number of this window; 0 in a file. */
  window: number;
  version: string;
  palette: Palette;
  /** A pose is right below this share of the diameter. */
  correct: number;
}

/** Colours by what they mean; `core/palette.py` says more of each. */
export interface Palette {
  /** Colours of poses, by stage. */
  stages: Record<string, string>;
  /** What the stages are, in words. */
  meanings: Record<string, string>;
  /** Colours of marks, by tone. */
  marks: Record<string, string>;
  /** In the order of their numbers, from 1. */
  classes: PixelClass[];
  /** Two runs that are compared, in pictures. */
  sides: Record<string, string>;
  /** These runs in charts. */
  side_lines: Record<string, string>;
  scene: Record<string, string>;
  /** The axes x, y and z of a pose. */
  axes: [string, string, string];
  grasps: Record<string, string>;
  motions: Record<string, string>;
  causes: string[];
  runs: string[];
  times: Record<string, string>;
  /** Hue [°], saturation and lightness [%] of the lowest and the highest hypothesis, by theme. */
  ranks: Record<string, [[number, number, number], [number, number, number]]>;
  scales: Record<string, [number, number, number][]>;
  /** A pixel without a value. */
  empty: string;
}

/** What became of a pixel in the score. */
export interface PixelClass {
  name: string;
  color: string;
  words: string;
}

/** Content of a page in a file. */
export interface FileMessage {
  t: "file";
  /** Opens the same in the program. */
  command: string;
  /** Which iterations have score maps. */
  maps: "all" | "end" | "marked";
  /** Whether it has the 3D view. */
  scene: boolean;
}

/** The open frame; sent again when another frame or session is opened, which replaces all that the page knew. */
export interface FrameMessage {
  t: "frame";
  /** New each time something is opened. */
  id: number;
  title: string;
  /** As `scene/image`, such as 50/1. */
  frame: string;
  /** All of the session. */
  frames: string[];
  source: string;
  /** A folder, or the name of the built-in scene. */
  dataset: string;
  /** The batch run that is open; "" = none. */
  run: string;
  preset: string;
  method: string;
  method_label: string;
  refiner: string;
  /** The threshold of the depth fit. */
  tau_m: number;
  colour_weight: number;
  camera: Camera;
  /** Blob of the photo. */
  rgb: string | null;
  /** Blob of float32 h×w [m], 0 = not measured. */
  depth: string;
  /** Blob of uint8 h×w×3, the photo as the colour term sees it; null where no model has colours. */
  smoothed: string | null;
  /** In solving order, those left out last. */
  objects: FrameObject[];
  support: SupportPlane | null;
  order: SolvingOrder | null;
  notes: string[];
  /** Empty where they are not known yet; `doubts` brings them. */
  doubts: DoubtShown[];
  /** Settings by dotted name that switch off all corrections of the data; empty where there are none. */
  as_read: Record<string, unknown>;
  session_file: string | null;
  recording: string | null;
  /** Built-in scenes that can be opened. */
  demos: string[];
  sessions: TitledSession[];
  breakpoints: BreakpointSettings;
  choices: Choices;
}

/** The pinhole camera of the frame. */
export interface Camera {
  /** Pixels across. */
  w: number;
  h: number;
  /** The intrinsic matrix by rows. */
  K: [number, number, number, number, number, number, number, number, number];
}

/** An instance of the frame; one that is left out has neither mask nor poses. */
export interface FrameObject {
  /** null where one that is left out has none. */
  id: number | null;
  obj_id: number;
  label: string;
  color: string;
  /** Number of its group in `order`, from 1; 0 = left out. */
  cluster: number;
  diameter_mm: number | null;
  symmetric: boolean;
  has_gt: boolean;
  gt: Pose | null;
  /** Score of the ground-truth pose. */
  gt_score: number | null;
  /** Visible share, 0 to 1, where the data set gives it. */
  visible: number | null;
  /** [u0, v0, u1, v1] of the mask, u1 and v1 beyond it. */
  box: [number, number, number, number] | null;
  mask: number[][];
  arms: InitialPose[];
  /** Steps that another program recorded. */
  recorded: number;
  /** Why it is not solved; "" where it is. */
  left_out: string;
}

/** A pose with which a hypothesis begins; errors are null without ground truth. */
export interface InitialPose {
  T: Pose;
  score: number;
  /** ADD(-S) [mm]. */
  err: number | null;
  deg: number | null;
  /** Error of the translation. */
  mm: number | null;
  plays: number;
  /** Mean reward with which the hypothesis begins. */
  mean: number;
  /** Its source: an estimator, a results file, disturbed ground truth. */
  source: string;
  /** Score by its source, on that source's own scale. */
  confidence: number | null;
}

/** The plane that objects stand on. */
export interface SupportPlane {
  /** Where gravity comes from: plane, world or given. */
  source: string;
  inlier_share: number;
  rms_mm: number;
  /** Between its normal and gravity. */
  tilt_deg: number;
  /** Numbers of the unknown objects around. */
  unknown: number[];
  /** Outline of the part that was seen, in the image. */
  outline: number[];
  /** Blob of uint8 h×w, 1 = a pixel of the background that lies on it. */
  inliers: string;
}

/** The order in which objects are solved, and why. */
export interface SolvingOrder {
  /** Groups of instances that are solved together, each group in its order. */
  clusters: number[][];
  /** The rule: recommended, published or given. */
  source: string;
  notes: string[];
  edges: OrderEdge[];
}

/** Two instances that depend on each other. */
export interface OrderEdge {
  /** contact: they may touch. occlusion: `first` hides part of `second`. support: `first` supports `second`. */
  kind: "contact" | "occlusion" | "support";
  first: number;
  second: number;
  strength: number;
  /** In words, with numbers. */
  evidence: string;
  /** ambiguous: left out of the order, as part of a cycle. cut: left out by the user or the setting. */
  state: "ambiguous" | "cut" | "used";
}

/** A doubt: frame data that do not fit together. */
export interface DoubtShown {
  kind: string;
  /** For a badge. */
  title: string;
  /** What was seen and what to check. */
  text: string;
  /** The objects that show it; empty: the whole frame. */
  objs: number[];
  /** How it shows in the image: poses, edges, depth; scene: only in 3D. */
  picture: string;
  /** Settings by dotted name with which a restart corrects the data; null where there are none. */
  put_right: Record<string, unknown> | null;
}

/** A session file that lies at hand. */
export interface TitledSession {
  path: string;
  title: string;
  /** The built-in scene that it is about; "" where it is another. */
  demo: string;
}

/** When a running method should stop and wait; unset = never. The page sets them: they stand in saved sessions. */
export interface BreakpointSettings {
  /** The accepted score is lower than the arm's previous one by more than this [score]. */
  score_falls_by: number | null;
  /** The accepted pose moved further than this [mm]. */
  jump_mm: number | null;
  /** The accepted pose turned further than this [deg]. */
  jump_deg: number | null;
  /** ADD(-S) of the accepted pose against ground truth grew by more than this [mm]. */
  error_grows_by_mm: number | null;
  /** The refined pose was accepted instead of the simulated one, by any margin: the usual case. */
  simulated_rejected: boolean;
  /** The simulated pose was accepted instead of the refined one. */
  refined_rejected: boolean;
  /** The bandit chose another hypothesis than before. */
  arm_switched: boolean;
  /** The object touches something and would tip: its centre of mass is outside its support after the simulation. */
  unstable: boolean;
  /** The simulated pose scores at least 0.2 less than the pose it began with. */
  physics_worse: boolean;
  /** A pose rendered to nothing, or its score was not a number. */
  empty_render: boolean;
  /** Thresholds of breakpoints that are off, saved by the page for when they are switched on. */
  waiting: ThresholdSettings;
}

/** Breakpoints with a threshold; unset = never. */
export interface ThresholdSettings {
  /** The accepted score is lower than the arm's previous one by more than this [score]. */
  score_falls_by: number | null;
  /** The accepted pose moved further than this [mm]. */
  jump_mm: number | null;
  /** The accepted pose turned further than this [deg]. */
  jump_deg: number | null;
  /** ADD(-S) of the accepted pose against ground truth grew by more than this [mm]. */
  error_grows_by_mm: number | null;
}

/** The settings and their choices. */
export interface Choices {
  methods: MethodChoice[];
  refiners: string[];
  presets: string[];
  estimators: string[];
  /** Those changed most first. */
  settings: EditableSetting[];
}

/** A method that can be chosen. */
export interface MethodChoice {
  name: string;
  label: string;
  /** Whether it accepts the best pose, rather than the last. */
  verifies: boolean;
}

/** A setting that a run can be restarted with. */
export interface EditableSetting {
  /** Dotted, as in a session file. */
  name: string;
  kind: "bool" | "choice" | "float" | "int" | "text";
  value: boolean | number | string;
  /** Value in the preset. */
  standard: boolean | number | string;
  choices: (boolean | number | string)[] | null;
  /** Whether it is one of the settings that are changed most. */
  common: boolean;
  /** Whether it may change during a run. */
  can_fork: boolean;
  help: string;
}

/** The branches, the oldest first. */
export interface BranchesMessage {
  t: "branches";
  list: BranchListed[];
  compare: ComparedBranches | null;
}

/** One run of the frame. */
export interface BranchListed {
  index: number;
  name: string;
  parent: number | null;
  /** The parent's iteration after which it forks. */
  from: number;
  /** Iterations after which settings of the score changed, beginning with 0. */
  scored: number[];
  recording: string | null;
  /** What its recording lacks, in words; "" where it is complete. */
  missing: string;
  /** Iterations made so far. */
  done: number;
  /** Iterations at its end. */
  total: number;
  over: boolean;
  method: string;
  /** Whether its refiner can show what it saw. */
  explains: boolean;
  /** Those that differ from the first branch's, by dotted name. */
  settings: Record<string, unknown>;
  changes: SettingsChange[];
  edits: MovedPose[];
  /** Edits of other frames, in words. */
  elsewhere: string[];
}

/** Settings that changed on the way. */
export interface SettingsChange {
  /** The settings hold after this iteration. */
  k: number;
  /** Values by dotted name. */
  settings: Record<string, unknown>;
}

/** A pose that was edited, and how far it is from the hypothesis's initial pose. */
export interface MovedPose {
  k: number;
  obj: number;
  arm: number;
  T: Pose;
  mm: number | null;
  deg: number | null;
}

/** Two branches side by side. */
export interface ComparedBranches {
  a: number;
  b: number;
}

/** Iterations of a branch, appended to those of the window; `from` 0 replaces all. */
export interface RunMessage {
  t: "run";
  branch: number;
  /** The first row is iteration `from` + 1. */
  from: number;
  total: number;
  over: boolean;
  /** What the recording lacks, in words; "" where it is complete. */
  missing: string;
  rows: IterationRow[];
  /** Initial poses by object, where they or their scores differ from the oldest branch's. */
  start: Record<string, InitialPose[]> | null;
  /** All marks of the branch so far. */
  marks: Mark[];
  notes: string[];
}

/** One iteration. */
export interface IterationRow {
  k: number;
  obj: number;
  arm: number;
  /** Its number among this arm's iterations. */
  n: number;
  /** Its number among this object's iterations. */
  own: number;
  pass: number | null;
  cluster: number;
  stages: ScoredStage[];
  accepted: "current" | "edited" | "flipped" | "initial" | "mixed" | "refined" | "simulated";
  /** Best pose of this object, after the iteration. */
  best: BestPose;
  /** [kind, text]. */
  events: (["arm_switched" | "edited" | "empty_render" | "flipped" | "kept_refined" | "kept_simulated" | "nan_score" | "new_best" | "new_best_scene" | "no_physics" | "physics_worse" | "refiner_stuck" | "score_fell" | "unstable", string])[];
  /** null where the method does not choose. */
  choice: ArmChoice | null;
  /** Hypotheses of this object, after the iteration. */
  arms: ArmState[];
  /** Number of simulated poses. */
  path: number | null;
  /** Other objects, at their places in the scene. */
  placed: PlacedObject[];
  scene: ScenePass | null;
  tree: SearchStep | null;
  ms: number;
  brief: string;
  /** What it did, in a sentence or two. */
  text: string;
}

/** A pose at one stage of an iteration; parts of the score are null where it was not scored. */
export interface ScoredStage {
  name: "current" | "edited" | "flipped" | "initial" | "mixed" | "refined" | "simulated";
  score: number | null;
  depth_fit: number | null;
  normal_fit: number | null;
  colour_fit: number | null;
  plausibility: number | null;
  /** ADD(-S) [mm]. */
  err: number | null;
  deg: number | null;
  /** Error of the translation. */
  mm: number | null;
  ms: number;
  T: Pose;
  /** What it did, in words. */
  text: string;
}

/** The best pose of an object so far. */
export interface BestPose {
  score: number;
  err: number | null;
  deg: number | null;
  mm: number | null;
  arm: number;
  /** The iteration that made it; 0 = an initial pose. */
  k: number;
  stage: "current" | "edited" | "flipped" | "initial" | "mixed" | "refined" | "simulated";
  T: Pose;
}

/** The bandit's numbers at its choice, one per arm; null where an arm was not played. */
export interface ArmChoice {
  plays: number[];
  mean: (number | null)[];
  /** Bonus for arms that were seldom played. */
  bonus: (number | null)[];
  /** mean + bonus. */
  ucb: (number | null)[];
  reason: string;
}

/** A hypothesis after an iteration. */
export interface ArmState {
  plays: number;
  mean: number;
  score: number;
  err: number | null;
  T: Pose;
}

/** Another object at its place in the scene. */
export interface PlacedObject {
  obj: number;
  T: Pose;
}

/** The outcome of a pass over the objects of a cluster. */
export interface ScenePass {
  number: number;
  /** Score of this pass's poses as a scene. */
  score: number;
  /** Score of the objects' best poses so far, as a scene. */
  best_known: number;
  /** Reward of the chosen arms. */
  reward: number;
  /** The highest score of all passes so far. */
  incumbent: number;
}

/** A step of the search tree. */
export interface SearchStep {
  cluster: number;
  /** Nodes from the root to the one visited. */
  branch: number[];
  /** The node that was added. */
  node: SearchNode | null;
  /** Why each node after the root was chosen, in words. */
  choices: string[];
  /** The other objects of the completed scene. */
  rollout: PlacedObject[];
  /** Pixels of the complete scene that are not explained. */
  cost: number;
  /** The lowest cost so far. */
  incumbent: number;
}

/** A node of the search tree. */
export interface SearchNode {
  node: number;
  parent: number;
  obj: number;
  arm: number;
  /** Share of the model's points that the segment explains at the initial pose. */
  lcp: number;
}

/** A mark on the timeline: an iteration that is worth a look. */
export interface Mark {
  k: number;
  obj: number;
  kind: string;
  text: string;
  tone: "best" | "edited" | "flip" | "problem" | "rejected" | "switched";
}

/** The outcome of a finished run, and why; sent again when physics or the score around the answers is known. */
export interface VerdictMessage {
  t: "verdict";
  branch: number;
  over: boolean;
  /** What a recording lacks, in words. */
  missing: string;
  objects: JudgedObject[];
  scene: JudgedScene;
  doubts: DoubtShown[];
  /** Reasons to doubt the physics. */
  notes: string[];
}

/** The outcome of one object; without an answer, the fields about the answer are null. */
export interface JudgedObject {
  obj: number;
  label: string;
  tone: "doubt" | "none" | "right" | "unknown" | "wrong";
  words: string;
  /** Up to this error an answer is right [mm]: 10 % of the diameter. */
  limit: number;
  findings: FindingShown[];
  score: number | null;
  gt_score: number | null;
  /** ADD(-S) [mm]. */
  err: number | null;
  deg: number | null;
  /** Error of the translation. */
  mm: number | null;
  /** What the error of the rotation is, in words: tilt or turn on the table. */
  way: string | null;
  k: number | null;
  arm: number | null;
  stage: "current" | "edited" | "flipped" | "initial" | "mixed" | "refined" | "simulated" | null;
  T: Pose | null;
  runner_up: RunnerUpPose | null;
  /** A distant pose that explains the image equally well. */
  also_fits: Pose | null;
  /** null before the score around the answer is known, and where the image allows no visibly different pose. */
  allowed: AllowedByImage | null;
  /** How the answer came about, in four to six moments. */
  film: MomentShown[];
  /** null where this or the ground truth is unknown. */
  trained: RefinerRange | null;
}

/** One thing that had a part in an answer that is wrong, missing or in doubt. */
export interface FindingShown {
  cause: string;
  title: string;
  text: string;
  /** The iteration to look at; 0 = before the first. */
  k: number | null;
  advice: string;
  /** Settings that may help, by dotted name. */
  try: Record<string, boolean | number | string> | null;
  /** Whether it comes from the batch, which re-ran to find it. */
  by_batch: boolean;
  /** The evidence, in the numbers of its cause (docs/causes.md); errors are ADD(-S) as a share of the diameter. */
  numbers: Record<string, number>;
  /** The tab whose picture of the answer shows it. */
  tab: string;
  /** The tab that shows it at its iteration. */
  tab_there: string;
}

/** The best pose of another hypothesis. */
export interface RunnerUpPose {
  arm: number;
  /** By how much its score is lower. */
  lead: number;
  apart_mm: number;
  T: Pose;
}

/** Samples of the poses that the image cannot distinguish from an answer. */
export interface AllowedByImage {
  /** At most 12: spread along the least certain motion, then isolated poses that look alike. */
  poses: Pose[];
  /** The least certain motion, in words. */
  words: string;
  /** Whether they are drawn from the start: the observation is ambiguous, or a turn is far from determined. */
  unasked: boolean;
}

/** A key moment of what the run did to an object. */
export interface MomentShown {
  /** 0 = before the first; the answer stands at the last. */
  k: number;
  /** The last stage that is shown; null = the whole iteration. */
  stage: "current" | "edited" | "flipped" | "initial" | "mixed" | "refined" | "simulated" | null;
  title: string;
  caption: string;
  /** The poses that are drawn over the photo: names and colours. */
  legend: [string, [number, number, number]][];
  /** As in the want `film`. */
  drawn: MomentDrawn;
}

/** The picture of a key moment: `[k, poses, map, layer]`. */
export type MomentDrawn = [k: number, poses: [string, Pose][], map: string, layer: string];

/** How far from the ground truth a learned refiner was trained to start, and how far the initial poses are. */
export interface RefinerRange {
  deg: number;
  /** For an object of this size. */
  mm: number;
  /** Turn [°] and shift of the object's middle [mm] of each initial pose. */
  starts: [number, number][];
}

/** The outcome of all objects together. */
export interface JudgedScene {
  tone: "doubt" | "none" | "right" | "unknown" | "wrong";
  words: string;
  /** The object to look at first. */
  worst: number | null;
  right: number;
  /** Objects with ground truth. */
  known: number;
}

/** All that is known has been sent. */
export interface ReadyMessage {
  t: "ready";
}

/** Doubts about the open frame's data, once they are known. */
export interface DoubtsMessage {
  t: "doubts";
  doubts: DoubtShown[];
}

/** Progress of long work. */
export interface BusyMessage {
  t: "busy";
  /** What is being done; "" = nothing. */
  text: string;
  /** How much is done, 0 to 1. */
  share: number | null;
  /** Whether it can be given up. */
  cancel: boolean;
  /** Whether `open` with `hulls` alone restarts the opening, or the waiting run, with hulls. */
  hulls: boolean;
  /** Blob of the photo of what is being opened. */
  picture: string | null;
}

/** The branches that are being computed. */
export interface RunningMessage {
  t: "running";
  /** The branch whose turn it is. */
  branch: number | null;
  branches: number[];
  /** The breakpoint at which a run stopped last. */
  stopped: string;
  remaining_s: number | null;
}

/** A short message. */
export interface NoteMessage {
  t: "note";
  text: string;
}

/** An error; everything is as before. */
export interface ErrorMessage {
  t: "error";
  text: string;
  offer: OfferedVerb | null;
}

/** What a button does nevertheless. */
export interface OfferedVerb {
  words: string;
  verb: AnyVerb;
}

/** What a window shows; the 3D view follows the window used last, and draws what it names. */
export interface Look {
  verb: "look";
  branch?: number;
  /** Iteration by whose settings poses are scored. */
  k?: number;
  /** The object in focus; None = no object: the frame is drawn. */
  obj?: number | null;
  draw?: DrawnPose[];
  /** Hypotheses of the object in focus. */
  hypotheses?: DrawnHypothesis[];
  /** The hypothesis that is drawn more clearly. */
  arm?: number;
  /** Poses of the object in focus that the image allows. */
  allowed?: Pose[];
  /** Poses of the object in focus whose axes are drawn. */
  axes?: Pose[];
  path?: PathMoment | null;
  grasp?: Grasp | null;
  /** Where to take the 3D view's camera. */
  camera?: "first" | "object" | "sensor" | null;
  scene?: SceneLook;
  /** Pixel whose ray, and the point that it sees, are drawn. */
  pixel?: [number, number] | null;
  ruler?: [[number, number], [number, number]] | null;
}

/** An object as the 3D view draws it at a pose: `[obj, T, role, opacity]`. */
export type DrawnPose = [obj: number, T: Pose, role: string, opacity: number];

/** A hypothesis of the object in focus as a ghost in the 3D view: `[T, share]`. */
export type DrawnHypothesis = [T: Pose, share: number];

/** The simulated path of an iteration, and which of its moments is drawn. */
export interface PathMoment {
  k: number;
  /** None = the path is not drawn, only the contacts at its end. */
  moment?: number | null;
}

/** The grasp that is drawn: at which pose, by the answer or the ground truth, and at which moment. */
export interface Grasp {
  T: Pose;
  by?: "pose" | "truth";
  moment?: number;
}

/** What the 3D view shows of a frame besides poses, and how. */
export interface SceneLook {
  hidden?: ("cloud" | "contacts" | "gravity" | "other objects" | "overlaps" | "own colours" | "photo" | "plane")[];
  cloud?: "class" | "distance to model" | "normals" | "photo";
  /** Side of the box around the object in focus to which the view is limited [diameters]; 4 = no limit. */
  box?: number;
  /** Share of the object in focus that is cut away, from the front. */
  cut?: number;
  gizmo_px?: number;
  text_px?: number;
}

/** Compute one more iteration at the end of a branch. */
export interface Step {
  verb: "step";
  branch?: number;
}

/** Go on computing a branch until it holds k iterations, whatever the breakpoints. */
export interface Seek {
  verb: "seek";
  k: number;
  branch?: number;
}

/** Go on computing a branch to its end, or to the next event; breakpoints stop both. */
export interface RunVerb {
  verb: "run";
  branch?: number;
  until?: "end" | "event";
}

/** Stop computing after the iteration at hand. */
export interface Pause {
  verb: "pause";
}

/** Cancel long work, leaving everything as it was before. */
export interface Cancel {
  verb: "cancel";
}

/** Begin the first run again with changed settings; the frame's branches are discarded. */
export interface Restart {
  verb: "restart";
  branch?: number;
  changes?: Record<string, unknown>;
  /** Whether other branches and edited poses may be lost. */
  discard?: boolean;
  /** Whether it then runs to its end. */
  run?: boolean;
}

/** Fork a branch after iteration k, with changed settings or from an edited pose. */
export interface Fork {
  verb: "fork";
  k: number;
  branch?: number;
  changes?: Record<string, unknown>;
  edit?: EditedPose | null;
  run?: boolean;
}

/** A pose that replaces the current one of a hypothesis. */
export interface EditedPose {
  obj: number;
  arm: number;
  T: Pose;
}

/** Begin a branch in which a pose is the only hypothesis of its object; other objects begin where they stand. */
export interface Refine {
  verb: "refine";
  obj: number;
  T: Pose;
  /** The iteration after which the other objects' poses are taken. */
  k: number;
  branch?: number;
  run?: boolean;
}

/** Open something; one of the fields says what. */
export interface Open {
  verb: "open";
  frame?: string;
  /** With a frame: the model that comes into focus. */
  object?: number | null;
  demo?: string;
  session?: string;
  recording?: string;
  /** Folder of a batch, or of several. */
  batch?: string;
  link?: string;
  answer?: number | null;
  /** For an answer: a recorded run of its frame, to be put beside it as B, both at their ends. */
  beside?: string;
  /** The frames of the open session, to be labelled. */
  label?: boolean;
  /** Whether physics uses the convex hull of every model, so that nothing has to be decomposed. */
  hulls?: boolean;
}

/** New initial poses of one object, as a new branch. */
export interface Estimate {
  verb: "estimate";
  obj: number;
  /** Name of the estimator; "session": the session's own. */
  estimator: string;
  branch?: number;
}

/** Name a branch, or remove it. */
export interface BranchVerb {
  verb: "branch";
  index: number;
  name?: string;
  remove?: boolean;
}

/** Put a run beside branch `a`: another branch, a run from the start with changed settings, or a recording. */
export interface Compare {
  verb: "compare";
  a?: number;
  b?: number | null;
  changes?: Record<string, unknown> | null;
  recording?: string;
  run?: boolean;
  stop?: boolean;
}

/** Change when a run stops and waits. */
export interface Break {
  verb: "break";
  changes: Record<string, unknown>;
}

/** Change the order in which objects are solved, or what stops them; one of the fields says what. */
export interface Order {
  verb: "order";
  branch?: number;
  /** (first, second, cut): whether the edge between two instances is ignored. */
  cut?: [number, number, boolean] | null;
  /** (instance, −1 or 1). */
  move?: [number, number] | null;
  /** (number of an unknown object, whether it is dropped and stops nothing). */
  drop?: [number, boolean] | null;
  reset?: boolean;
  /** As of `Restart`. */
  discard?: boolean;
}

/** Compute something that takes long and send it as the answer `id`. */
export interface Evaluate {
  verb: "evaluate";
  id: string;
  what: "grasp";
  obj: number;
  T: Pose;
  branch?: number;
  k?: number;
}

/** Ask for what is needed to show something; of one slot the latest wins. */
export interface Want {
  verb: "want";
  id: string;
  of: AnyWant;
  slot?: string;
}

/** The score of a pose, or of several together, pixel by pixel. */
export interface MapsWanted {
  what: "maps";
  branch?: number;
  k?: number;
  obj?: number | null;
  T?: Pose | null;
  poses?: [number, Pose][];
}

/** The outlines of a model in the image at some poses. */
export interface OutlinesWanted {
  what: "outlines";
  obj: number;
  poses: Pose[];
}

/** The evidence of a doubt about the data in the image. */
export interface DoubtWanted {
  what: "doubt";
  /** Index in the list of the frame or the verdict. */
  index: number;
  branch?: number;
}

/** A model as it would look at a pose. */
export interface ShadedWanted {
  what: "shaded";
  obj: number;
  T: Pose;
}

/** Whether the objects' poses are stable, and what the simulation did. */
export interface PhysicsWanted {
  what: "physics";
  /** The object in focus. */
  obj: number;
  branch?: number;
  /** Iteration by whose settings it is worked out. */
  k?: number;
  /** Poses of the focus to examine in detail, by name: before and after. */
  poses?: [string, Pose][];
  stands?: Standing[];
  /** Whether only the focus is examined, among the others at their poses. */
  alone?: boolean;
  /** Iteration whose simulated path is shown. */
  path?: number | null;
}

/** An object at its current pose: `[obj, T, waits]`. */
export type Standing = [obj: number, T: Pose, waits: boolean];

/** The point measured at a pixel, and its distance from the objects at their poses. */
export interface PointWanted {
  what: "point";
  pixel: [number, number];
  branch?: number;
  stands?: Standing[];
}

/** The result of refining a pose: refined, settled and verified among the other objects at their poses. */
export interface RefinedWanted {
  what: "refined";
  obj: number;
  T: Pose;
  branch?: number;
  stands?: Standing[];
}

/** The score around a pose of an object. */
export interface LandscapeWanted {
  what: "landscape";
  obj: number;
  T: Pose;
  branch?: number;
  k?: number;
  /** Curves along all axes, the map over two of them, or distant poses that fit as well. */
  part?: "curves" | "other" | "slice";
  /** Axes of the map: across and up. */
  axes?: [number, number];
}

/** Two branches side by side, iteration by iteration. */
export interface ComparisonWanted {
  what: "compare";
  a: number;
  b: number;
  /** Iterations of both that exist: a browser asks again when there are more. */
  done?: [number, number];
}

/** What a learned refiner saw in an iteration. */
export interface CropsWanted {
  what: "crops";
  k: number;
  branch?: number;
}

/** The objects of a scene over its frames. */
export interface SequenceWanted {
  what: "sequence";
  /** A run of the open batch; "" = that of the open frame, or none. */
  run?: string;
  /** null = that of the open frame. */
  scene?: number | null;
  /** Number of answers so far: a browser asks again when there are more. */
  done?: number;
}

/** What another program recorded of an object's poses, beside our scores. */
export interface RecordedWanted {
  what: "recorded";
  obj: number;
  branch?: number;
  /** Number of iterations so far: a browser asks again when there are more. */
  done?: number;
}

/** Pictures of the key moments of an object. */
export interface FilmWanted {
  what: "film";
  obj: number;
  moments: MomentDrawn[];
  branch?: number;
}

/** Write a file: the session, a recording, the page, the table of results, the score maps, the film, the verbs. */
export interface Save {
  verb: "save";
  what: "film" | "maps" | "recording" | "results" | "session" | "share" | "verbs";
  branch?: number;
  /** For maps: the iteration that is shown. */
  k?: number;
  /** For maps and film: the object. */
  obj?: number | null;
  /** For maps: the poses of the object, by name. */
  poses?: [string, Pose][];
  name?: string;
  replace?: boolean;
}

/** Give answers of the gallery a tag, or take it away. */
export interface Tag {
  verb: "tag";
  answers: number[];
  tag: string;
  on?: boolean;
}

/** Try the remedies of causes on the answers of the gallery, end a trial, or write the session with some of them. */
export interface Fix {
  verb: "fix";
  /** Whether each remedy is tried on all wrong answers; else on those with its causes. */
  every?: boolean;
  /** Remedies that are also tried together; or that are written. */
  take?: string[];
  /** The session file that is written; "" = none. */
  write?: string;
  stop?: boolean;
}

/** Place an object in a frame for labelling, where the photo was clicked: upright, at the depth there. */
export interface Place {
  verb: "place";
  obj_id: number;
  pixel: [number, number];
}

/**
 * Search for an object inside a box, or on the pixels that a scribble covers; the best poses become its
 * candidates.
 */
export interface Find {
  verb: "find";
  obj_id: number;
  /** Left, top, right, bottom [px]. */
  box?: [number, number, number, number] | null;
  scribble?: [number, number][];
}

/** Refine a labelled object from a pose, settle it and verify it. */
export interface Snap {
  verb: "snap";
  obj: number;
  T: Pose;
}

/** Set the state of a label, or remove it. */
export interface Decide {
  verb: "decide";
  obj: number;
  state: "accepted" | "proposed" | "removed" | "uncertain";
  note?: string;
}

/** Undo the last change of the frame's labels, or redo it. */
export interface UndoLabel {
  verb: "undolabel";
  redo?: boolean;
}

/** Carry the labels of the frame to those that follow, until one needs a person. */
export interface Carry {
  verb: "carry";
  /** Frames. */
  most?: number;
}

/** Write the labels as the ground truth of a BOP data set. */
export interface Export {
  verb: "export";
  /** Folder of a data set that is written; none = into the data set itself. */
  out?: string;
  /** Whether uncertain ones are written, too. */
  uncertain?: boolean;
  /** Objects whose proposed symmetries the user confirmed. */
  symmetries?: number[];
  overwrite?: boolean;
}

/** A file was written. */
export interface WrittenMessage {
  t: "written";
  name: string;
  /** null: only handed to the browser, and kept nowhere else. */
  path: string | null;
  /** Where it can be downloaded. */
  url: string;
  /** What the file does not hold. */
  note: string;
}

/** The gizmo in 3D was dragged. */
export interface EditedMessage {
  t: "edited";
  obj: number;
  T: Pose;
}

/** A pixel was clicked in 3D. */
export interface PickedMessage {
  t: "picked";
  u: number;
  v: number;
}

/** The window that the 3D view follows. */
export interface Scene3DMessage {
  t: "scene3d";
  window: number | null;
}

/** What this window looks at from now on. */
export interface ViewMessage {
  t: "view";
  patch: ViewPatch;
  /** The iteration that a link names, shown once its row is there; null = the end. */
  at?: number | null;
}

/** Changes of what a window looks at; the rest stays. */
export interface ViewPatch {
  branch?: number;
  k?: number;
  obj?: number | null;
  stage?: string | null;
  arm?: number | null;
  moment?: number | null;
  /** null: no pose is edited any more. */
  edited?: null;
}

/** When a run stops and waits. */
export interface BreakpointsMessage {
  t: "breakpoints";
  breakpoints: BreakpointSettings;
}

/** The answer to a want of a window. */
export interface AnswerMessage {
  t: "answer";
  /** Id of the want, or of `evaluate`. */
  id: string;
  answer: AnyAnswer;
}

/**
 * The score of a pose, or of several together, pixel by pixel.
 *
 * Arrays over the region: rendered [m], 0 = none; angle [rad]; f_d; f_n; classes, 0 = none; counted; and for a model
 * with colours, correlation and rendered_rgb, which a shared file has only where colour counts. NaN = no value.
 */
export interface MapsAnswer {
  what: "maps";
  /** [u0, v0, width, height]. */
  region: [number, number, number, number];
  score: ScoreNumbers;
  scale: MapScale;
  blob: string;
  arrays: StoredArray[];
}

/** A score with its parts, which are null for a score other than Eq. 1. */
export interface ScoreNumbers {
  score: number;
  depth_fit: number | null;
  normal_fit: number | null;
  colour_fit: number | null;
  plausibility: number | null;
  /** Number of pixels that count. */
  n: number;
  /** Pixels by class. */
  counts: Record<string, number>;
  /** ADD(-S) [mm]; null also of several objects together. */
  err: number | null;
  deg: number | null;
  mm: number | null;
}

/** What the colours of maps are relative to. */
export interface MapScale {
  /** Nearest and farthest depth [m], the same for all poses of these objects. */
  depth: [number, number];
  tau_mm: number;
  colour_weight: number;
}

/** Position of an array in a blob; `[name, dtype, offset, n, step]`. */
export type StoredArray = [name: string, dtype: string, offset: number, n: number, step: number | null];

/** Polygons of each pose that was asked for. */
export interface OutlinesAnswer {
  what: "outlines";
  /** A polygon is [u, v, u, v, …] px, closed; pixel centres are whole. */
  outlines: number[][][];
}

/** The evidence of a doubt about the data in the image. */
export interface DoubtAnswer {
  what: "doubt";
  shapes: DoubtShape[];
}

/** Layers that show a doubt: masks, edges of depth, models as the data place them and as they would fit. */
export interface DoubtShape {
  role: "edges" | "fits" | "given" | "mask";
  label: string;
  /** null: of the whole frame. */
  obj: number | null;
  polygons: number[][];
}

/** A model as it would look: RGBA, at the image's resolution or twice that. */
export interface ShadedAnswer {
  what: "shaded";
  /** [u0, v0, width, height]. */
  region: [number, number, number, number];
  /** null where it does not show in the image. */
  url: string | null;
}

/** Whether the objects' poses are stable, and what the simulation did. */
export interface PhysicsAnswer {
  what: "physics";
  /** Why nothing is simulated; "" where it is. */
  empty: string;
  doubts: string[];
  surroundings: SupportAround | null;
  /** Each object at its current pose. */
  objects: PosePhysics[];
  /** Examined poses of the focus: before and after, with the data for a picture. */
  poses: PosePhysics[];
  /** Deepest first. */
  overlaps: OverlappingPair[];
  path: SimulatedMotion | null;
}

/** The surroundings: what supports and stops the objects. */
export interface SupportAround {
  /** plane: nothing else; observed: what the depth image shows; mesh: a mesh of the surroundings. */
  source: string;
  plane: PlaneFit;
  surfaces: number;
  solids: number;
  unknown: UnknownSolid[];
}

/** How well the support plane fits. */
export interface PlaneFit {
  /** Share of the background on the plane. */
  share: number;
  rms_mm: number;
  /** Between its normal and gravity. */
  tilt_deg: number;
}

/** An object in the depth image that no model explains. */
export interface UnknownSolid {
  number: number;
  /** Sides of its box, longest first. */
  size_mm: number[];
  /** Whether it stops nothing. */
  dropped: boolean;
}

/** Geometry of a pose; null where physics is not asked, and for what only a picture needs. */
export interface PosePhysics {
  obj: number;
  /** The stage of the pose; "" = where the object stands. */
  name: string;
  tone: "amber" | "green" | "grey" | "red";
  words: string;
  /** To the nearest surface. */
  gap_mm: number | null;
  /** Depth of the deepest penetration. */
  depth_mm: number | null;
  /** What it penetrates. */
  into: string | null;
  /** Centre of mass to the edge of the support polygon; negative: outside; null without support. */
  margin_mm: number | null;
  /** Whether friction at the contacts can hold it; null where that is unknown. */
  stable: boolean | null;
  touches: string[] | null;
  /** Footprint, seen from above as the three below. */
  outline: [number, number][] | null;
  /** The support polygon. */
  polygon: [number, number][] | null;
  /** Centre of mass. */
  com: [number, number] | null;
  contacts: [number, number][] | null;
}

/** An overlap of two objects. */
export interface OverlappingPair {
  /** The object that is solved later. */
  first: number;
  second: number;
  depth_mm: number;
}

/** The simulation in the latest iteration of the object. */
export interface SimulatedMotion {
  k: number;
  /** Number of poses: one more than steps. */
  n: number;
  poses: Pose[];
  /** Distance from the first pose, at each pose. */
  moved_mm: number[];
  turned_deg: number[];
  /** Contacts at the end of each step, the strongest first. */
  contacts: TouchedPartner[][];
  /** Whether the simulator gives contacts. */
  has_contacts: boolean;
  tipping: TippingMoment | null;
  words: string;
}

/** A body that is touched at the end of a step. */
export interface TouchedPartner {
  name: string;
  /** Contact points. */
  n: number;
  force_n: number;
  /** Depth of the deepest penetration. */
  depth_mm: number;
}

/** The moment at which the centre of mass leaves the support. */
export interface TippingMoment {
  step: number;
  overhang_mm: number;
}

/**
 * The point measured at a pixel, in the camera frame; null where nothing was measured. `obj`: the object with the
 * nearest surface.
 */
export interface PointAnswer {
  what: "point";
  point_mm: [number, number, number] | null;
  normal: [number, number, number] | null;
  /** Distance to the nearest surface of an object at its pose, negative inside; null beyond three times τ. */
  residual_mm: number | null;
  obj: number | null;
}

/** The result of refining a pose, with its verification. */
export interface RefinedAnswer {
  what: "refined";
  /** The proposed pose itself where nothing scores higher. */
  T: Pose;
  score: ScoreNumbers;
  /** Score of the proposed pose. */
  before: ScoreNumbers;
  /** Whether the pose is stable; grey where no support is known or physics is off. */
  tone: "amber" | "green" | "grey" | "red";
  /** The change in words. */
  words: string;
}

/** Answer to `landscape`: the score around a pose along twelve axes. */
export interface CurvesAnswer {
  what: "curves";
  T: Pose;
  score: number;
  curves: ScoreCurve[];
  /** The least certain axis, in words. */
  undetermined: string;
  undetermined_mm: number;
  undetermined_deg: number;
}

/** The score along one axis. */
export interface ScoreCurve {
  axis: number;
  /** Frame of the axis. */
  frame: string;
  kind: "shift" | "turn";
  words: string;
  unit: "mm" | "\u00b0";
  offsets: number[];
  scores: number[];
  /** Range of offsets that the score cannot distinguish. */
  low: number;
  high: number;
  /** In words: ±0.3 mm. */
  width: string;
  /** At each offset. */
  poses: Pose[];
}

/** Answer to `landscape`: the score over two axes. */
export interface SliceAnswer {
  what: "slice";
  across: SliceAxis;
  up: SliceAxis;
  /** By rows, from below. */
  scores: number[][];
  poses: Pose[][];
}

/** One of the two axes of a map of scores. */
export interface SliceAxis {
  words: string;
  unit: "mm" | "\u00b0";
  offsets: number[];
}

/** Answer to `landscape`: distant poses that fit as well. */
export interface OtherAnswer {
  what: "other";
  other: OtherPose | null;
  /** Turns after which the shape looks nearly the same, in words. */
  near: string[];
}

/** A distant pose that fits as well. */
export interface OtherPose {
  T: Pose;
  score: number;
  score_of_answer: number;
  /** Difference of both scores that the noise of the image explains. */
  noise: number;
  apart_mm: number;
  words: string;
}

/** Two branches side by side, as far as both are computed. */
export interface CompareAnswer {
  what: "compare";
  names: [string, string];
  settings: DifferingSetting[];
  /** Whether both score by the same rule. */
  scores_alike: boolean;
  pairs: RunPair[];
  /** The first differing action, and the first differing score. */
  departures: RunDeparture[];
  /** Where they diverge, in words. */
  words: string;
  rows: ObjectInBoth[];
  /** Scores of A's answers and of B's, each set as one scene; null for a single object. */
  frame: [number, number] | null;
  effort: BothEfforts;
}

/** A setting in which both differ; `[name, a, b]`, values in words. */
export type DifferingSetting = [name: string, a: string, b: string];

/** The n-th iteration on one object in both runs; `[obj, n, a, b]`. */
export type RunPair = [obj: number, n: number, a: number | null, b: number | null];

/** The first difference of B from A. */
export interface RunDeparture {
  /** Number of the pair, from 1; 0 = before iteration 1. */
  place: number;
  kind: string;
  /** What B does, as a phrase that follows "B". */
  text: string;
  a: number | null;
  b: number | null;
}

/** An object in both runs; null where a run does not solve it. */
export interface ObjectInBoth {
  obj: number;
  name: string;
  a: ComparedAnswer | null;
  b: ComparedAnswer | null;
  /** The run nearer to the ground truth or, without it, of the higher score; null where this is open. */
  winner: "A" | "B" | "even" | null;
}

/** One run's answer for an object. */
export interface ComparedAnswer {
  /** By the run's own settings. */
  score: number;
  /** By those of A. */
  score_by_a: number;
  /** ADD(-S) [mm]. */
  err: number | null;
  deg: number | null;
  mm: number | null;
  k: number;
  arm: number;
}

/** Costs of both runs so far. */
export interface BothEfforts {
  a: RunEffort;
  b: RunEffort;
}

/** Cost of a run so far. */
export interface RunEffort {
  iterations: number;
  planned: number;
  refiner_calls: number;
  /** Refiner calls that only complete a scene. */
  rollout_calls: number;
  ms: number;
}

/** Inputs and outputs of a learned refiner in an iteration. */
export interface CropsAnswer {
  what: "crops";
  /** The latest iteration on the object; null = none. */
  k: number | null;
  /** Why there are no steps. */
  empty: string;
  steps: RefinerStepShown[];
  refiner: string;
  /** How far from the ground truth it began, and how far it was trained for, in words. */
  start: string;
}

/** One step of a refiner. */
export interface RefinerStepShown {
  /** What it saw, as a PNG. */
  url: string;
  words: string[];
}

/** What another program recorded, as far as the run has repeated it. */
export interface RecordedAnswer {
  what: "recorded";
  rows: RecordedPose[];
  /** Rank correlation of both scores; null of fewer than four. */
  rank: number | null;
}

/** A pose of another program, with its score and ours. */
export interface RecordedPose {
  /** 0 = an initial pose. */
  k: number;
  arm: number;
  name: string;
  theirs: number | null;
  ours: number | null;
  ms: number | null;
  note: string;
}

/**
 * The objects of a scene over its frames; no lanes where fewer than two frames have answers.
 *
 * Arrays over lanes and frames: state, 0 nothing, 1 pose, 2 no pose, 3 not solved; key in the gallery, -1 = in none;
 * and those of the following that are known: err, ADD(-S) [mm]; share, that of the diameter; score; recorded_score,
 * another program's; colour_fit; moved_mm and turned_deg since the last frame with a pose; undetermined_mm;
 * missing_depth, share of the object's pixels. NaN = no value.
 */
export interface SequenceAnswer {
  what: "sequence";
  /** Name of the batch; "" = none. */
  run: string;
  scene: number;
  /** All scenes. */
  scenes: number[];
  frames: string[];
  lanes: SequenceLane[];
  marks: SequenceMark[];
  /** Frame of reference of the motions. */
  reference: "camera" | "world";
  /** Meaning of each kind of mark; empty where the frames are not a sequence. */
  legend: Record<string, string>;
  /** Larger changes are jumps. */
  jump_mm: number;
  jump_deg: number;
  blob: string;
  arrays: StoredArray[];
}

/** An object over the frames. */
export interface SequenceLane {
  name: string;
  /** Its model. */
  object: number;
  /** How it moves; "" where the frames are not a sequence. */
  words: string;
}

/** A mark; `[lane, frame, kind]`, both by index. */
export type SequenceMark = [lane: number, frame: number, kind: "flip" | "jump" | "lost" | "recovered"];

/** Answer to `evaluate`: a grasp by a pose and by the ground truth. */
export interface GraspAnswer {
  what: "grasp";
  pose: GraspOutcome;
  truth: GraspOutcome;
}

/** How a simulated grasp went and ended; empty where none was carried out. */
export interface GraspOutcome {
  verdict: string;
  good: boolean;
  /** Source of the grasps: annotated or sampled. */
  source: string;
  /** Grasps in which the gripper hits nothing. */
  free: number;
  blocked: number;
  /** Why none was carried out. */
  words: string;
  /** Moments. */
  n: number;
  /** One per moment, as all below. */
  stages: string[];
  /** Between the fingers. */
  gap_mm: number[];
  /** Force of both fingers on the object. */
  force_n: number[][];
  /** Rise of the object since the start. */
  rise_mm: number[];
  /** Bodies that the gripper presses on. */
  touches: string[][];
  frames: GraspFrame[];
}

/** One moment of a grasp, from the side. */
export interface GraspFrame {
  /** Palm and both fingers. */
  gripper: [number, number][][];
  /** [obj, outline]. */
  objects: [number, [number, number][]][];
}

/** Pictures of key moments: the photo with contours, and the map beside it. */
export interface FilmAnswer {
  what: "film";
  urls: string[];
}

/** An answer that cannot be given. */
export interface GoneAnswer {
  what: "gone";
  /** Why. */
  gone: string;
}

/** The gallery; sent again when a watched folder changes or a tag is set. */
export interface AnswersMessage {
  t: "answers";
  /** How many objects are right, in words. */
  outcome: string;
  /** How many frames have doubtful data, and why. */
  doubt: string;
  /** What cannot be read. */
  notes: string[];
  runs: string[];
  /** Unfinished runs beside them. */
  unfinished: number;
  /** Why tags cannot be read. */
  faults: string[];
  /** Filters until the user chooses others: values by filter. */
  first: Record<string, string>;
  orders: GalleryOrder[];
  rows: GalleryRow[];
  /** In a watched folder: frames of the open session now. */
  frames?: string[] | null;
}

/** One way to sort the gallery. */
export interface GalleryOrder {
  id: string;
  words: string;
  /** All answers in that order. */
  keys: number[];
}

/** An answer as a card; its index in `rows` is its key. */
export interface GalleryRow {
  key: number;
  /** Name of its run's folder. */
  run: string;
  frame: string;
  /** null for a frame that failed as a whole, or waits. */
  obj: number | null;
  /** Its model. */
  object: number | null;
  name: string;
  method: string;
  tone: "doubt" | "none" | "right" | "seen" | "unknown" | "waiting" | "wrong";
  /** Its result, to filter by. */
  result: string;
  score: number | null;
  /** ADD(-S) [mm]. */
  err: number | null;
  /** ADD(-S) to the nearest pose that the image allows beside ground truth [mm]. */
  err_seen: number | null;
  /** Largest error of a right answer [mm]. */
  limit: number | null;
  /** The iteration to open. */
  k: number;
  /** Its title. */
  cause: string;
  evidence: string;
  status: string;
  /** Why there is no answer. */
  message: string;
  /** Share that is not hidden, 0 to 1. */
  visible: number | null;
  undetermined_mm: number | null;
  undetermined_deg: number | null;
  /** Time of its iterations. */
  ms: number;
  tags: string[];
  /** Whether its frame can be opened. */
  opens: boolean;
  /** Whether it has a small picture. */
  thumb: boolean;
  /** Whether it has a film. */
  film: boolean;
  /** Only in reports, as all below: the group of its run. */
  group?: string;
  /** Which of two runs is wrong, in words. */
  compared?: string;
  /** Opens the frame in the program. */
  command?: string;
  /** Number of the part of the document that holds its frame. */
  part?: number | null;
  /** File beside the report that holds its frame. */
  file?: string | null;
}

/** Numbers of runs, each in the unit that is shown. */
export interface ReportMessage {
  t: "report";
  title: string;
  session_title: string;
  /** How many runs, frames and objects, in words. */
  counted: string;
  notes: string[];
  /** [run, why]. */
  left_out: [string, string][];
  columns: ReportColumn[];
  /** Thresholds of recall curves [% of the diameter]. */
  thresholds: number[];
  sections: ReportSection[];
  /** Remedies that were tried on these runs. */
  fix: FixShown | null;
}

/** A number of a group. */
export interface ReportColumn {
  id: string;
  label: string;
  hint: string;
  unit: string;
  digits: number;
  /** 1: more is better, -1: less, 0: neither. */
  better: number;
}

/** Runs on the same data. */
export interface ReportSection {
  data: string;
  session_title: string;
  n_frames: number;
  headline: string;
  next: NextStep | null;
  doubt: string;
  has_truth: boolean;
  same_objects: boolean;
  /** What BOP scores are averaged over, or why there are none. */
  bop: string;
  /** Meaning of the intervals. */
  intervals: string;
  /** The group. */
  best: number;
  groups: ReportGroup[];
  objects: ObjectNumbers[];
  hardest: HardObject[];
  n_hard: number;
  /** [setting, value by group]. */
  differing: [string, string[]][];
  /** Difference of two runs with ground truth. */
  change: PairDifference | null;
  /** Answers that lie apart, of two runs without ground truth. */
  apart: ApartAnswers[];
  tracks: ReportTrack[];
}

/** A recommendation of what to look at next. */
export interface NextStep {
  group: number;
  text: string;
  /** The answer to begin with. */
  key: number;
  /** Its name and frame. */
  begin: string;
}

/** Runs that differ only in their seeds. */
export interface ReportGroup {
  name: string;
  runs: string[];
  n_objects: number;
  n_with_truth: number;
  /** By column. */
  numbers: Record<string, [number | null, number | null, number | null]>;
  /** Difference of recall to the best group's [%]; null for the best group. */
  behind: [number | null, number | null, number | null] | null;
  curve: RecallCurve | null;
  /** [title, failures], the most frequent first. */
  causes: [string, number][];
  /** Share of the pairs of a wrong and a right answer in which the wrong one scores higher. */
  misleads: number | null;
  /** Milliseconds a frame. */
  stages: Record<string, number>;
  /** [end, by answers, by ground truth]. */
  grasps: [string, number, number][];
  /** Version, date, time and machine of its first run. */
  made: string[];
  /** TOML. */
  session: string;
}

/** Recall over the thresholds [%], and where several runs or frames allow it its 95 % interval. */
export interface RecallCurve {
  recall: number[];
  low: (number | null)[] | null;
  high: (number | null)[] | null;
}

/** An object model over the groups; null where a group does not have it. */
export interface ObjectNumbers {
  id: number;
  name: string;
  cells: (ObjectCell | null)[];
}

/** An object model in one group. */
export interface ObjectCell {
  n: number;
  /** Share [%]. */
  right: number | null;
  /** BOP average recall [%]. */
  ar: number | null;
  median_mm: number | null;
  score: number | null;
  undetermined_mm: number | null;
  /** The most frequent cause. */
  cause: string;
}

/** An object of a frame that most groups get wrong. */
export interface HardObject {
  /** Its worst answer. */
  key: number;
  frame: string;
  name: string;
  wrong_groups: number;
  groups: number;
  /** Answers, of `n`. */
  right: number;
  n: number;
  best: BestGroup | null;
  cause: string;
}

/** Which group gets an object right most often; `[name, right, n]`. */
export type BestGroup = [name: string, right: number, n: number];

/** Changes from one run to the other. */
export interface PairDifference {
  n: number;
  better: number;
  worse: number;
  now_right: number;
  now_wrong: number;
  both_wrong: number;
  /** Objects that only A, and only B, has. */
  only: [number, number];
  /** Errors that differ by less count as the same [% of the diameter]. */
  same: number;
  /** The most improved first. */
  objects: ObjectChange[];
  frames: FrameChange[];
}

/** An object of a frame in both runs; errors are shares of the diameter [%]. */
export interface ObjectChange {
  frame: string;
  name: string;
  turned: "" | "right" | "wrong";
  errors: [number | null, number | null];
  /** Error of B less that of A. */
  by: number | null;
  keys: [number, number];
}

/** A frame in both runs; errors are means over objects that both have an answer for [%]. */
export interface FrameChange {
  frame: string;
  n: number;
  errors: [number | null, number | null];
  /** How many of A and of B are right. */
  right: number[];
}

/** An object without ground truth whose answers differ between two runs. */
export interface ApartAnswers {
  frame: string;
  name: string;
  mm: number;
  deg: number;
  scores: [number | null, number | null];
  keys: [number, number];
}

/** An object over the frames of a sequence. */
export interface ReportTrack {
  run: string;
  name: string;
  scene: number;
  frames: number;
  flips: number;
  /** Flips in 100 frames. */
  per_100: number;
  jumps: number;
  no_pose: number;
  /** Median motion of frames that neither flip nor jump. */
  mm: number | null;
  deg: number | null;
  drift_mm: number | null;
  /** Objects that flip and jump most. */
  moved: TrackMove[];
}

/** How an object moved on the way to a frame; `[frame, mm, deg, kind]`. */
export type TrackMove = [frame: number, mm: number, deg: number, kind: string];

/** The table of the remedies that were tried. */
export interface FixShown {
  rows: FixLine[];
  answers: FixedAnswer[];
}

/** What a remedy did for a cause, as a row of fix.csv (docs/tables.md). */
export interface FixLine {
  remedy: string;
  /** Its title. */
  cause: string;
  /** Whether answers are compared by their fit, as without ground truth. */
  fit: boolean;
  tried: number;
  came_right: number;
  worse: number;
  right_tried: number;
  broke: number;
  right_known: number;
  net: [number | null, number | null, number | null];
  /** Computing time added per frame. */
  seconds: number | null;
  /** Answers that were tried, and those that were right: indices in the table's list. */
  answers: number[];
}

/** An answer before and after a remedy. */
export interface FixedAnswer {
  /** In the gallery; null where it is not there. */
  key: number | null;
  name: string;
  frame: string;
  was_bad: boolean;
  /** 1: came right, or fits better; -1: broke, or fits worse. */
  change: -1 | 0 | 1;
  /** ADD(-S) before and after [mm]. */
  errors: [number | null, number | null];
  scores: [number | null, number | null];
  /** The run with the remedy; "" where it cannot be opened from here. */
  recording: string;
}

/** The labels of the open frame, and how far the folder is. */
export interface LabelsMessage {
  t: "labels";
  frame: string;
  models: PlaceableModel[];
  labels: LabelShown[];
  /** Those that have some. */
  frames: Record<string, FrameLabels>;
  /** Where they are written. */
  file: string;
  undo: boolean;
  redo: boolean;
  /** The folder into which ground truth can be written: the data set itself, or one beside it. */
  export: string;
}

/** A model that can be placed. */
export interface PlaceableModel {
  obj_id: number;
  name: string;
  /** What is proposed: "every turn about z"; "" = none, or not worked out yet. */
  symmetry: string;
}

/** A label of the open frame. */
export interface LabelShown {
  /** The instance, as of the frame's objects. */
  obj: number;
  obj_id: number;
  name: string;
  T: Pose;
  light: "amber" | "green" | "red";
  reasons: string[];
  state: "accepted" | "proposed" | "uncertain";
  note: string;
  score: number;
  fit_mm: number;
  sinks_mm: number;
  undetermined_mm: number;
  undetermined_deg: number;
  /** placed, estimated, given, carried from 1/3. */
  begun: string;
  seconds: number;
  candidates: CandidatePose[];
}

/** A pose that was searched for, the best first. */
export interface CandidatePose {
  T: Pose;
  score: number;
}

/** What a frame of the folder has. */
export interface FrameLabels {
  labels: number;
  accepted: number;
  /** Those still proposed. */
  undecided: number;
  /** The worst of the undecided, and red where any label is; else green. */
  light: "amber" | "green" | "red";
}

/** The trial of remedies on the runs of the gallery, running or finished. */
export interface FixMessage {
  t: "fix";
  running: boolean;
  /** Frames done, of `total`. */
  done: number;
  total: number;
  /** Why it ended early. */
  fault: string;
  table: FixShown | null;
}

export type AnyAnswer =
  | MapsAnswer
  | OutlinesAnswer
  | DoubtAnswer
  | ShadedAnswer
  | PhysicsAnswer
  | PointAnswer
  | RefinedAnswer
  | CurvesAnswer
  | SliceAnswer
  | OtherAnswer
  | CompareAnswer
  | CropsAnswer
  | RecordedAnswer
  | SequenceAnswer
  | GraspAnswer
  | FilmAnswer
  | GoneAnswer;

export type AnyVerb =
  | Look
  | Step
  | Seek
  | RunVerb
  | Pause
  | Cancel
  | Restart
  | Fork
  | Refine
  | Open
  | Estimate
  | BranchVerb
  | Compare
  | Break
  | Order
  | Evaluate
  | Want
  | Save
  | Tag
  | Fix
  | Place
  | Find
  | Snap
  | Decide
  | UndoLabel
  | Carry
  | Export;

export type AnyWant =
  | MapsWanted
  | OutlinesWanted
  | DoubtWanted
  | ShadedWanted
  | PhysicsWanted
  | PointWanted
  | RefinedWanted
  | LandscapeWanted
  | ComparisonWanted
  | CropsWanted
  | SequenceWanted
  | RecordedWanted
  | FilmWanted;
