// What the server and the page tell each other; only a checker reads this file.

/**
 * @typedef {{ up?: string, unit?: string, fps_source?: number, skip?: number, map?: string, floor?: number, root?: string,
 *   take?: string, mirror_axis?: string }} Reading
 * @typedef {{ kind: string, text: string, fix?: { label: string, body: Reading } }} Doubt
 * @typedef {{ id: string, name: string, state: 'reading' | 'ready' | 'failed', seconds?: number, fps?: number, frames?: number,
 *   rig?: string | null, format?: string, joints?: number, doubts: Doubt[], music?: boolean, beats?: number[], error?: string,
 *   floor?: number, character?: boolean, reading?: Reading }} Clip
 *   character: its file has a mesh
 * @typedef {{ id: string, name: string, kept: boolean, rejected: boolean, seconds: number, frames: number, fps: number,
 *   job: string | null, variation: number, seed: number, note: string, generated_s: number[][], given: string, free: string,
 *   source: string | null, rig: string | null, opening: boolean, kept_name: string | null, made: { joints: number[], from: number, to: number }[],
 *   score?: number, verdict?: string, rank?: number[] }} Dance
 * @typedef {'free' | 'given' | 'edit' | 'loop' | 'timeline'} Kind
 * @typedef {{ kind: Kind, clip?: string, joints?: string, free?: string[], seconds?: number, fps?: number,
 *   labels?: Record<string, string>, seed?: number, temperature?: number, top_p?: number, guidance?: number, feet?: 'lock' | 'off', path?: number[][], variations: number,
 *   best?: number, loop?: 'back' | 'pose', loop_over?: number }} Make
 * @typedef {{ id: string, kind: Kind, make: Make, dances: string[], text: string | null, opening: boolean, started: number,
 *   state: 'waiting' | 'running' | 'done' | 'failed' | 'cancelled', frames: number, of: number,
 *   since: number | null }} Job since: the last event before its first frames
 * @typedef {{ name: string, smpl: number, label: string, group: string }} ModelJoint
 * @typedef {{ name: string, fps: number, new_fps: number, labels: Record<string, string[]>, joints: ModelJoint[],
 *   groups: string[], paths: boolean }} Model new_fps: of a dance without a clip; paths: whether it can be led along one
 * @typedef {{ undo: number, redo: number, undo_name: string | null, redo_name: string | null }} Undo
 * @typedef {{ clip: string, from_s: number }} Music
 * @typedef {{ version: string, project: string, model: Model, clips: Clip[], dances: Dance[], jobs: Job[],
 *   music: Music | null, undo: Undo, search_s: number, maps: string[], last_event: number }} State
 *
 * @typedef {{ from: number, to: number, state: 'given' | 'generated' | 'partly', segment: number | null }} Span
 * @typedef {{ group: string, spans: Span[], joints: { name: string, spans: Span[] }[] }} Row
 * @typedef {{ index: number, clip: string | null, joints: string | null, from: number, to: number, at: number,
 *   labels: Record<string, string>, assumed: string[], given?: number[], place?: { turn_rad: number, x: number, y: number, z: number } }} Segment
 * assumed: keys that the text of a timeline with trouble doesn't say
 * @typedef {{ text: string, seconds: number, fps: number | null, rig: string | null, transition: number,
 *   clips: Record<string, { clip: string | null, file: string | null }>, segments: Segment[], rows: Row[],
 *   trouble: { line: number, column: number, text: string }[], notes: string[] }} Timeline
 * @typedef {Record<string, any> & { op: string }} Edit
 * @typedef {{ clip: string, from_s: number, to_s: number, score: number }} Match
 *
 * @typedef {{ label: string, name?: string, smpl?: number, group?: string } | null} PointJoint
 * @typedef {import('./figure.js').FigureData & { joints?: PointJoint[], contacts?: { point: number, spans: number[][] }[],
 *   made?: { points: number[], from: number, to: number }[] }} FigureData
 * @typedef {{ job: string, variation: number, dance: string, from: number, figure_head?: FigureData, data: string }} Frames
 */

export {};
