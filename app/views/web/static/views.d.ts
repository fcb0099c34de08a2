// Written by `python -m tests.app.view_types` from the view values of the features (app/features/NAME/view.py).

/** The line; `text` is empty where there is nothing to speak of. */
export interface AnswerView {
  tone: "lost" | "ok" | "quiet" | "warning";
  text: string;
  working: boolean;
  diagnose: number | null;
  thorough: boolean;
  applies: boolean;
  show: number | null;
}

/** A part that was left out. */
export interface BlameRow {
  name: string;
  size: string;
  select: string;
  seek: number | null;
}

/** Of the frame shown; none before somebody asks. */
export interface BlameView {
  possible: boolean;
  frame: number;
  doing: string;
  methods: MethodBlame[];
  silent: string[];
}

export interface CheckRow {
  quantity: string;
  mark: string;
  tint: string;
  hint: string;
  sentence: string;
  numbers: string;
  name: string;
}

/** What a method did at a frame, in order. */
export interface Details {
  uses: string;
  stages: Stage[];
  groups: Group[];
  facts: Fact[];
}

/** The newest examination; `stretch` is None before the first one. */
export interface DoctorView {
  stretch: [number, number] | null;
  progress: string;
  problem: string;
  answer: string;
  causes: Suspect[];
  others: Suspect[];
  reruns: RerunTable[];
  silent: string[];
  left: string[];
  helped: boolean;
  untried: boolean;
}

export interface EventRow {
  frame: number;
  frames: string;
  label: string;
  sentence: string;
  severity: string;
  alarming: boolean;
  help: string;
}

/** The events nearest to the frame shown, and the numbers of those that are not listed. */
export interface EventsView {
  frame: number;
  rows: EventRow[];
  earlier: number;
  later: number;
  omitted: number;
  computed: number;
}

/** The verdicts at a frame; `frame` is -1 before the first. */
export interface ExplainView {
  frame: number;
  kind: string;
  time_s: number;
  waiting: string;
  skipped: string;
  thinned: boolean;
  cards: MethodCard[];
  settings: string[];
  plotted: string[];
  notes: string[];
}

export interface Fact {
  label: string;
  text: string;
  quantity: string;
}

export interface FunnelStage {
  name: string;
  count: number;
  limits: boolean;
  why: string;
}

/** Of the methods that track features; none of others. */
export interface FunnelView {
  methods: MethodFunnel[];
}

/** The checks behind one question. */
export interface Group {
  question: string;
  text: string;
  checks: CheckRow[];
  crowd: CheckRow[];
}

/** A colour, and what it means; colours between two that are named have no text. */
export interface LegendItem {
  colour: string;
  text: string;
}

/** The items in the order of their row; none where no tracks are drawn. */
export interface LegendView {
  title: string;
  items: LegendItem[];
}

export interface MethodBlame {
  label: string;
  colour: string;
  frame: number;
  said: string[];
  rows: BlameRow[];
}

/** How a method does: its verdict, the check that decided it, and the others that failed. */
export interface MethodCard {
  method: string;
  label: string;
  colour: string;
  severity: string;
  headline: string;
  detail: string;
  tag: string;
  when: string;
  decisive: CheckRow | null;
  failed: CheckRow[];
  ongoing: Since[];
  details: Details | null;
}

export interface MethodFunnel {
  label: string;
  colour: string;
  frame: number;
  stages: FunnelStage[];
}

/** What one setting did to the stretch. */
export interface Rerun {
  option: string;
  helps: boolean;
  located: number;
  frames: number;
  segments: number;
  failures: string;
}

export interface RerunTable {
  first: number;
  last: number;
  answer: string;
  rows: Rerun[];
  left: string[];
}

/** A warning of an earlier frame that still holds. */
export interface Since {
  frame: number;
  headline: string;
  sentence: string;
}

/** One of the steps that a method took, in order. */
export interface Stage {
  name: string;
  ms: string;
  text: string;
}

export interface Suspect {
  name: string;
  state: string;
  strength: number;
  evidence: string;
  undecided: string;
  remedy: string;
  frames: number[];
}
