/* The panel of ``report/live``: what was measured beside what the model does, simulated here.

The page has the programs of its models in ``servoModels`` and their data as deflated JSON in the
element ``live-data``.  Texts of logs and models are only ever set as text, so none becomes markup. */
"use strict";

(() => {
    const WIDE = 720; // pixels from which charts are high
    const MOST_SUBSTEPS = 1e7; // of a run: some seconds
    const WARM = 800; // ms in which an engine learns a model
    const WARM_ROWS = 200; // of a run by which it does
    const STEPS = 1000; // of a slider
    const DECADES = 100; // ends of a slider that are further apart, as a ratio, have a logarithm between
    const SLOW = 0.05; // share of the usual rate below which an output rests
    const CLEAR = 0.1; // of the floor: an error within is noise, and no share of it means anything
    const REST = 0.05; // share of a run before its step
    const SHAPES = ["step", "sine", "triangle", "pulse"];

    function make(tag, given = {}, ...inside) {
        const element = document.createElement(tag);
        for (const [name, value] of Object.entries(given)) {
            if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
            else if (name in element && name !== "list") element[name] = value;
            else element.setAttribute(name, value);
        }
        element.append(...inside);
        return element;
    }

    function number(value, digits = 4) {
        if (!Number.isFinite(value)) return "–";
        const size = Math.abs(value);
        const rounded = Number(value.toPrecision(digits));
        return size !== 0 && (size < 1e-3 || size >= 1e6)
            ? rounded.toExponential()
            : String(rounded);
    }

    /* Numbers */

    function inflated(text) {
        const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
        return new Response(
            new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate")),
        );
    }

    async function decoded(text) {
        const planes = new Uint8Array(await inflated(text).arrayBuffer());
        const count = planes.length / 8,
            whole = new Uint8Array(planes.length);
        for (let byte = 0; byte < 8; byte++) {
            for (let k = 0; k < count; k++) whole[8 * k + byte] = planes[byte * count + k];
        }
        return new Float64Array(whole.buffer);
    }

    async function read(run, model) {
        const [times, inputs, counted, ...measured] = await Promise.all(
            [run.times, run.inputs, run.counted, ...Object.values(run.measured)].map(decoded),
        );
        const names = Object.keys(run.measured);
        return {
            ...run,
            times,
            inputs,
            counted,
            stamps: times.map((time) => time + run.begin),
            measured: new Map(names.map((name, k) => [name, measured[k]])),
            settled: run.settle > 0 ? settled(run, model, times, inputs) : null,
        };
    }

    /* The rows of a run that is held before its log begins; one that is put to a motion is held apart. */
    function settled(run, model, times, inputs) {
        const later = times.map((time) => time + run.settle),
            width = model.inputs.length;
        if (run.placed.length) return { times: later, inputs };
        const longer = new Float64Array(times.length + 1),
            held = new Float64Array(inputs.length + width);
        longer.set(later, 1);
        held.set(run.held[0]);
        held.set(inputs, width);
        return { times: longer, inputs: held };
    }

    /* A run that nobody measured: one input driven, the others as they are set. */
    function driven(model, drive) {
        const rows = Math.round(drive.duration / model.step) + 1,
            width = model.inputs.length;
        const times = new Float64Array(rows),
            inputs = new Float64Array(rows * width);
        for (let k = 0; k < rows; k++) {
            times[k] = k * model.step;
            model.inputs.forEach((input, column) => {
                let value = drive.held[column];
                if (input.name === model.driven[0]) value += drive.size * shaped(drive, times[k]);
                const low = input.low ?? -Infinity,
                    high = input.high ?? Infinity;
                inputs[k * width + column] = Math.min(Math.max(value, low), high);
            });
        }
        return {
            name: "",
            times,
            stamps: times,
            inputs,
            counted: new Float64Array(rows).fill(1),
            measured: new Map(),
            settled: null,
            settle: 0,
            held: [],
            placed: [],
            constants: {},
            stretches: [],
            after: {},
            note: "",
        };
    }

    function shaped(drive, time) {
        const turn = (time * drive.rate) % 1;
        switch (drive.shape) {
            case "sine":
                return Math.sin(2 * Math.PI * time * drive.rate);
            case "triangle":
                return 1 - 4 * Math.abs(((turn + 0.25) % 1) - 0.5);
            case "pulse":
                return turn < 0.5 ? 1 : -1;
            default:
                return time >= REST * drive.duration ? 1 : 0;
        }
    }

    /* All outputs of a run, column by column, or why there are none; ``set`` says which start. */
    function simulated(model, values, run, set) {
        const { program } = model,
            width = model.outputs.length,
            at = new Float64Array(1);
        const p = Float64Array.from(values);
        for (const [name, value] of Object.entries(run.constants)) p[model.place.get(name)] = value;
        const of = (sets) => sets[Math.min(set, sets.length - 1)];
        const told = run.settled ?? run,
            later = Object.values(run.after),
            { order, times, inputs } = instants(told, later, model.inputs.length),
            rows = times.length;
        const x = program.start(p),
            out = new Float64Array(rows * width);
        let code = 0;
        if (run.placed.length) {
            const held = of(run.held),
                before = Float64Array.of(0, run.settle);
            if (run.settle > 0) {
                const scratch = new Float64Array(2 * width),
                    both = Float64Array.of(...held, ...held);
                code = program.run(p, x, 2, before, both, scratch, MOST_SUBSTEPS, at);
            }
            for (const [place, value] of of(run.placed)) x[place] = value;
        }
        code ||= program.run(p, x, rows, times, inputs, out, MOST_SUBSTEPS, at);
        if (code) {
            return { why: model.faults[code] ?? "its numbers are no longer finite" };
        }
        const count = told.times.length,
            names = Object.keys(run.after);
        return {
            columns: model.outputs.map(({ name }, k) => {
                const first = count * (names.indexOf(name) + 2) - run.times.length;
                return run.times.map((_, row) => out[order[first + row] * width + k]);
            }),
        };
    }

    /* Rows of a run and instants so much later, in the order of time; ``order`` has the place of each. */
    function instants({ times, inputs }, later, width) {
        if (!later.length) return { order: times.map((_, k) => k), times, inputs };
        const count = times.length,
            at = [0, ...later].flatMap((wait) => Array.from(times, (time) => time + wait)),
            sorted = at.map((_, k) => k).sort((a, b) => at[a] - at[b] || a - b),
            order = new Float64Array(at.length),
            held = new Float64Array(at.length * width);
        let row = 0;
        sorted.forEach((k, place) => {
            order[k] = place;
            while (row + 1 < count && times[row + 1] <= at[k]) row++;
            held.set(inputs.subarray(row * width, (row + 1) * width), place * width);
        });
        return { order, times: Float64Array.from(sorted, (k) => at[k]), inputs: held };
    }

    /* Let the engine compile a model while the reader looks: short runs, between which the page answers. */
    function warmed(model, run) {
        const rows = Math.min(WARM_ROWS, run.times.length),
            until = performance.now() + WARM;
        const part = {
            ...run,
            times: run.times.subarray(0, rows),
            inputs: run.inputs.subarray(0, rows * model.inputs.length),
            settled: null,
            placed: [],
        };
        const values = Object.values(model.sets).at(-1);
        const more = () => {
            simulated(model, values, part, 0);
            if (performance.now() < until) setTimeout(more);
        };
        setTimeout(more, 100);
    }

    function column(table, k, width) {
        const found = new Float64Array(table.length / width);
        for (let row = 0; row < found.length; row++)
            found[row] = table[row * width + k];
        return found;
    }

    function rms(errors, counted, low, high) {
        let sum = 0,
            count = 0;
        for (let k = low; k < high; k++) {
            if (counted[k] && errors[k] === errors[k]) {
                sum += errors[k] * errors[k];
                count++;
            }
        }
        return count ? Math.sqrt(sum / count) : NaN;
    }

    const less = (a, b) => a.map((value, k) => value - b[k]);
    const times = (scale, values) => values.map((value) => scale * value);
    /* What uPlot draws: a gap is null there. */
    const gaps = (values) =>
        values.includes(NaN) ? Array.from(values, (it) => (Number.isNaN(it) ? null : it)) : values;

    /* Charts */

    function colour(name) {
        return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
    }

    function chart(place, height, label, series, key, zoomed) {
        const axis = {
            stroke: colour("muted"),
            grid: { stroke: colour("grid"), width: 1 },
            ticks: { stroke: colour("grid"), width: 1 },
        };
        const options = {
            width: Math.max(place.clientWidth, 200),
            height,
            series: [
                { label: "time [s]", value: (_, v) => (v == null ? "" : number(v, 6)) },
                ...series,
            ],
            scales: { x: { time: false } },
            axes: [
                { ...axis, size: 34, values: (_, ticks) => ticks.map((it) => number(it, 6)) },
                {
                    ...axis,
                    size: 62,
                    label,
                    labelSize: 18,
                    labelGap: 0,
                    values: (_, ticks) => ticks.map((it) => number(it)),
                },
            ],
            cursor: { sync: { key }, drag: { x: true, y: false }, points: { size: 6 } },
            legend: { live: true },
            hooks: {
                setScale: [
                    (_, scale) => {
                        if (scale === "x") zoomed(place);
                    },
                ],
            },
        };
        const drawn = new uPlot(options, [[0], ...series.map(() => [0])], place);
        touched(drawn);
        return drawn;
    }

    /* One finger moves along a zoomed chart, two zoom. */
    function touched(drawn) {
        const fingers = new Map(),
            over = drawn.over;
        let begin = null;
        const ends = () =>
            [...fingers.values()]
                .map((it) => it.clientX - over.getBoundingClientRect().left)
                .sort((a, b) => a - b);
        const down = (event) => {
            if (event.pointerType !== "touch") return;
            fingers.set(event.pointerId, event);
            begin = { at: ends(), min: drawn.scales.x.min, max: drawn.scales.x.max };
        };
        const up = (event) => {
            fingers.delete(event.pointerId);
            begin = null;
        };
        const move = (event) => {
            if (!begin || !fingers.has(event.pointerId)) return;
            fingers.set(event.pointerId, event);
            const now = ends(),
                perPixel = (begin.max - begin.min) / over.clientWidth;
            let { min, max } = begin;
            if (now.length === 2 && begin.at.length === 2) {
                const factor =
                    Math.max(begin.at[1] - begin.at[0], 1) / Math.max(now[1] - now[0], 1);
                const centre = min + (perPixel * (begin.at[0] + begin.at[1])) / 2;
                min = centre - (centre - min) * factor;
                max = centre + (max - centre) * factor;
            } else {
                const shift = (begin.at[0] - now[0]) * perPixel;
                [min, max] = [min + shift, max + shift];
            }
            drawn.setScale("x", { min, max });
        };
        over.addEventListener("pointerdown", down);
        over.addEventListener("pointermove", move);
        for (const end of ["pointerup", "pointercancel", "pointerleave"])
            over.addEventListener(end, up);
    }

    /* The panel */

    class Panel {
        constructor(place, given) {
            this.place = place;
            place.panel = this; // for scripts of the reader
            this.given = given;
            this.id = place.id;
            this.runs = new Map();
            this.build();
            this.choose(0);
            matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () =>
                this.redraw(),
            );
            new ResizeObserver(() => this.resize()).observe(this.charts);
            if (given.dropped) this.explorer = new servoExplorer(this, make);
        }

        /* Show a log of the reader's, beside those that the page has. */
        add(run) {
            const { model } = this;
            const told = { ...run, settled: settled(run, model, run.times, run.inputs) };
            model.runs = [...model.runs, told];
            this.runs.set(told, told);
            this.logs.list.append(make("option", {}, run.name));
            this.logs.list.selectedIndex = model.runs.length - 1;
            this.logs.field.hidden = model.runs.length < 2;
            this.fill();
            this.show(model.runs.length - 1);
        }

        build() {
            const pick = (label, changed) => {
                const list = make("select", { onchange: () => changed(list.selectedIndex) });
                return {
                    list,
                    field: make("label", { className: "live-pick" }, make("span", {}, label), list),
                };
            };
            this.models = pick("model", (k) => this.choose(k));
            this.logs = pick("log", (k) => this.show(k));
            this.outputs = pick("signal", () => this.redraw());
            this.belows = pick("below", () => this.redraw());
            this.stretches = pick("part", (k) => this.look(this.run.stretches[k - 1]));
            this.sets = make("div", {
                className: "live-sets",
                role: "group",
                "aria-label": "values",
            });
            this.badge = make("strong", { className: "live-badge" });
            this.score = make("span", { className: "live-score" });
            this.regimes = make("p", { className: "live-note" });
            this.spoken = make("span", { className: "live-spoken", role: "status" });
            this.upper = make("div", { className: "live-chart", role: "img" });
            this.lower = make("div", { className: "live-chart live-errors", role: "img" });
            const zoom = (text, name, done) =>
                make(
                    "button",
                    { type: "button", title: name, "aria-label": name, onclick: done },
                    text,
                );
            const zooms = make(
                "div",
                { className: "live-zoom", role: "group", "aria-label": "zoom" },
                zoom("−", "zoom out", () => this.zoom(2)),
                zoom("+", "zoom in", () => this.zoom(0.5)),
                zoom("◀", "earlier", () => this.zoom(1, -0.25)),
                zoom("▶", "later", () => this.zoom(1, 0.25)),
                zoom("all", "whole log", () => this.look()),
            );
            this.note = make("p", { className: "live-note" });
            this.charts = make(
                "div",
                { className: "live-charts" },
                make("p", { className: "live-state" }, this.badge, " ", this.score),
                this.spoken,
                this.upper,
                this.lower,
                this.regimes,
                zooms,
                this.note,
            );
            this.controls = make("div", { className: "live-controls" });
            this.place.append(
                make(
                    "div",
                    { className: "live-bar" },
                    this.models.field,
                    this.logs.field,
                    this.outputs.field,
                    this.belows.field,
                    this.stretches.field,
                    this.sets,
                ),
                make("div", { className: "live-grid" }, this.charts, this.controls),
            );
            this.models.list.replaceChildren(
                ...this.given.models.map((it) => make("option", {}, it.name)),
            );
            this.models.field.hidden = this.given.models.length < 2;
        }

        choose(k) {
            const model = (this.model = this.given.models[k]);
            model.program = servoModels[model.program] ?? model.program;
            model.place = new Map(model.parameters.map((it, place) => [it.name, place]));
            this.values = Float64Array.from(Object.values(model.sets).at(-1));
            this.drive = {
                shape: SHAPES[0],
                size: model.driven[1],
                rate: 2 / (model.duration || 1),
                duration: model.duration,
                held: model.inputs.map((it) => it.rest),
            };
            const names = Object.keys(model.sets);
            this.sets.replaceChildren(
                ...names.map((name, set) =>
                    make(
                        "button",
                        {
                            type: "button",
                            onclick: () => {
                                this.values.set(model.sets[name]);
                                this.fill();
                                this.update();
                            },
                        },
                        name,
                    ),
                ),
            );
            this.logs.list.replaceChildren(...model.runs.map((it) => make("option", {}, it.name)));
            this.logs.field.hidden = model.runs.length < 2;
            this.fill();
            this.show(0);
        }

        async show(k) {
            const { model } = this,
                run = model.runs[k];
            this.run = null; // nothing is drawn meanwhile
            const asked = (this.asked = {});
            if (run && !this.runs.has(run)) this.runs.set(run, await read(run, model));
            if (this.asked !== asked) return; // another was chosen
            this.run = run ? this.runs.get(run) : driven(model, this.drive);
            warmed(model, this.run);
            const names = this.run.measured.size
                ? [...this.run.measured.keys()]
                : model.outputs.map((it) => it.name);
            const before = this.outputs.list.selectedOptions[0]?.value;
            this.outputs.list.replaceChildren(
                ...names.map((it) =>
                    make("option", { value: it, selected: it === before }, it.replaceAll("_", " ")),
                ),
            );
            this.outputs.field.hidden = names.length < 2;
            this.stretches.list.replaceChildren(
                make("option", {}, "whole log"),
                ...this.run.stretches.map(([name]) => make("option", {}, name)),
            );
            this.stretches.field.hidden = !this.run.stretches.length;
            const inputs = model.inputs.map((it) => it.name);
            const first = this.run.measured.size ? ["error"] : [];
            const below = first.length ? [...first, ...inputs] : inputs;
            this.belows.list.replaceChildren(
                ...below.map((it) => make("option", { value: it }, it.replaceAll("_", " "))),
            );
            this.belows.list.value = first[0] ?? model.driven[0];
            this.belows.field.hidden = below.length < 2;
            this.note.textContent = this.run.note;
            this.redraw();
        }

        get output() {
            const name = this.outputs.list.value;
            return this.model.outputs.find((it) => it.name === name) ?? this.model.outputs[0];
        }

        /* The input below the curves, undefined where their errors are. */
        get shownInput() {
            return this.model.inputs.find((it) => it.name === this.belows.list.value);
        }

        get measured() {
            return this.run.measured.get(this.output.name);
        }

        /* The name of the set that the values are, "" for none. */
        get set() {
            const same = ([, values]) => values.every((value, k) => value === this.values[k]);
            return Object.entries(this.model.sets).reverse().find(same)?.[0] ?? "";
        }

        redraw() {
            if (!this.run) return;
            this.above?.destroy();
            this.below?.destroy();
            const { output } = this,
                wide = this.charts.clientWidth >= WIDE * 0.75;
            const [nominal] = Object.keys(this.model.sets),
                unit = output.unit === "1" ? "" : ` [${output.unit}]`;
            const shown = (it) => (_, v) => (v == null ? "" : number(v, 4));
            const line = (label, stroke, more = {}) => ({
                label,
                stroke,
                width: 1.5,
                value: shown(label),
                points: { show: false },
                ...more,
            });
            const live = () => colour(this.set ? "blue" : "orange");
            const measured = line(this.given.beside, `${colour("ink")}59`, { width: 4 }); // shows beneath the other curves
            const first = line(nominal, colour("muted"), { dash: [5, 4], width: 1 });
            const key = `live-${this.id}`,
                zoomed = (place) => this.zoomed(place);
            const logged = Boolean(this.measured);
            this.above = chart(
                this.upper,
                wide ? 300 : 190,
                `${output.name.replaceAll("_", " ")}${unit}`,
                [...(logged ? [measured] : []), first, line("simulated", live)],
                key,
                zoomed,
            );
            const input = this.shownInput,
                name = input?.name.replaceAll("_", " ");
            this.below = chart(
                this.lower,
                wide ? 170 : 120,
                input ? `${name} [${input.unit}]` : `error${unit}`,
                input ? [line(name, colour("green"))] : [first, line("simulated", live)],
                key,
                zoomed,
            );
            this.upper.setAttribute(
                "aria-label",
                `${output.name} over time, ${this.given.beside} and simulated`,
            );
            this.lower.setAttribute("aria-label", `${name ?? "error"} over time`);
            this.fresh = true;
            this.base = null;
            this.draw();
        }

        /* Ask for a drawing with the next frame, once however often it is asked. */
        update() {
            this.waiting ??= requestAnimationFrame(() => {
                this.waiting = null;
                this.draw();
            });
        }

        draw() {
            if (!this.run) return;
            const { model, run, output } = this,
                [nominal] = Object.values(model.sets);
            const k = model.outputs.indexOf(output),
                names = Object.keys(model.sets),
                { set } = this;
            if (!model.runs.length) this.base = null;
            this.base ??=
                simulated(model, nominal, run, 0).columns?.[k] ??
                new Float64Array(run.times.length).fill(NaN);
            const now = simulated(
                model,
                this.values,
                run,
                set ? names.indexOf(set) : names.length - 1,
            );
            this.why = now.why ?? "";
            this.now = now.columns?.[k] ?? new Float64Array(run.times.length).fill(NaN);
            const curves = [this.base, this.now],
                { measured, fresh } = this;
            const shown = (values) => gaps(times(output.scale, values));
            const upper = [run.stamps, ...(measured ? [measured, ...curves] : curves).map(shown)];
            if (measured) this.errors = curves.map((it) => less(it, measured));
            const input = this.shownInput,
                width = model.inputs.length;
            const lower = input
                ? [times(input.scale, column(run.inputs, model.inputs.indexOf(input), width))]
                : this.errors.map(shown);
            for (const [drawn, data] of [
                [this.above, upper],
                [this.below, [run.stamps, ...lower]],
            ]) {
                const { min, max } = drawn.scales.x;
                drawn.setData(data, fresh);
                if (!fresh) drawn.setScale("x", { min, max });
            }
            this.fresh = false;
            this.tell();
        }

        tell() {
            const { set, output } = this,
                what = set || this.given.other;
            this.badge.textContent = set || this.given.other;
            this.badge.classList.toggle("live-if", !set);
            for (const button of this.sets.children)
                button.setAttribute("aria-pressed", String(button.textContent === set));
            let text = this.why ? `cannot be simulated: ${this.why}` : "";
            if (!text && this.measured) {
                const { min, max } = this.above.scales.x,
                    { stamps, counted } = this.run;
                const low = stamps.findIndex((it) => it >= min),
                    after = stamps.findIndex((it) => it > max);
                const high = after < 0 ? stamps.length : after;
                const [before, now] = this.errors.map((it) =>
                    rms(it, counted, Math.max(low, 0), high),
                );
                const unit = output.unit === "1" ? "" : ` ${output.unit}`,
                    { floor } = output;
                const size = (it) => `${number(output.scale * it, 3)}${unit}`;
                text = `error ${size(now)} RMS`;
                if (set !== Object.keys(this.model.sets)[0]) text += `, nominal ${size(before)}`;
                if (floor !== null) text += `, noise ${size(floor)}`;
                const beyond = before - (floor ?? 0);
                if (beyond > CLEAR * (floor ?? 0) && now !== before && Number.isFinite(now))
                    text += `: ${number(100 * Math.min((before - now) / beyond, 1), 3)} % of the gap closed`;
                if (low > 0 || high < stamps.length) text += ", in what is shown";
                this.regimes.textContent = this.byRegime(Math.max(low, 0), high);
            }
            this.score.textContent = text;
            clearTimeout(this.speaking);
            this.speaking = setTimeout(() => {
                this.spoken.textContent = `${what}: ${text}`;
            }, 800);
        }

        /* Errors while the nominal model rests, rises and falls. */
        byRegime(low, high) {
            const { base, output } = this,
                { stamps, counted } = this.run,
                [, errors] = this.errors;
            const rates = base.map((value, k) =>
                k ? (value - base[k - 1]) / (stamps[k] - stamps[k - 1]) : 0,
            );
            const usual =
                Float64Array.from(rates, Math.abs).sort()[Math.floor(0.95 * rates.length)] * SLOW;
            const of = {
                "at rest": (rate) => Math.abs(rate) <= usual,
                rising: (rate) => rate > usual,
                falling: (rate) => rate < -usual,
            };
            const size = (is) =>
                rms(
                    errors,
                    counted.map((count, k) => count && is(rates[k])),
                    low,
                    high,
                );
            const sizes = Object.entries(of)
                .map(([name, is]) => [name, size(is)])
                .filter(([, it]) => Number.isFinite(it));
            return sizes.length < 2
                ? ""
                : `Error ${sizes.map(([name, it]) => `${name} ${number(output.scale * it, 3)}`).join(", ")}${output.unit === "1" ? "" : ` ${output.unit}`}.`;
        }

        /* Zoom */

        zoomed(place) {
            if (this.following || !this.above || !this.below) return;
            const from = place === this.upper ? this.above : this.below,
                to = from === this.above ? this.below : this.above;
            const { min, max } = from.scales.x;
            if (to.scales.x.min === min && to.scales.x.max === max) return;
            this.following = true;
            to.setScale("x", { min, max });
            this.following = false;
            if (this.errors && !this.fresh) requestAnimationFrame(() => this.tell());
        }

        look(stretch) {
            const { stamps } = this.run;
            const [, min, max] = stretch ?? ["", stamps[0], stamps.at(-1)];
            this.above.setScale("x", { min, max });
            if (!stretch) this.stretches.list.selectedIndex = 0;
        }

        zoom(factor, shift = 0) {
            const { stamps } = this.run,
                [first, last] = [stamps[0], stamps.at(-1)];
            const { min, max } = this.above.scales.x;
            const half = Math.min(factor * (max - min), last - first) / 2;
            let centre = (min + max) / 2 + shift * (max - min);
            centre = Math.min(Math.max(centre, first + half), last - half);
            this.above.setScale("x", { min: centre - half, max: centre + half });
        }

        resize() {
            for (const [drawn, place] of [
                [this.above, this.upper],
                [this.below, this.lower],
            ]) {
                if (drawn && Math.abs(drawn.width - place.clientWidth) > 1)
                    drawn.setSize({ width: place.clientWidth, height: drawn.height });
            }
        }

        /* Controls */

        fill() {
            const { model } = this,
                open = new Set(
                    [...this.controls.querySelectorAll("details[open]")].map(
                        (it) => it.dataset.name,
                    ),
                );
            const plant = model.parameters.filter((it) => !it.effect),
                effects = Object.keys(model.effects);
            const first = effects.filter(
                (name) =>
                    this.isOn(name) ||
                    model.parameters.some((it) => it.effect === name && it.shown),
            );
            const folded = (name, inside, always = false) =>
                make(
                    "details",
                    { className: "live-more", open: always || open.has(name), "data-name": name },
                    make("summary", {}, name),
                    ...inside,
                );
            const rest = effects.filter((name) => !first.includes(name)),
                others = plant.filter((it) => !it.shown);
            const alone = others.length === plant.length;
            this.controls.replaceChildren(
                ...(model.runs.length ? [] : [this.drives()]),
                ...first.map((name) => this.effect(name)),
                ...plant.filter((it) => it.shown).map((it) => this.slider(it)),
                ...(rest.length
                    ? [
                          folded(
                              first.length
                                  ? `${rest.length} other effects`
                                  : `${rest.length} effects`,
                              rest.map((name) => this.effect(name)),
                          ),
                      ]
                    : []),
                ...(others.length
                    ? [
                          folded(
                              alone ? "parameters" : `${others.length} other parameters`,
                              others.map((it) => this.slider(it)),
                              alone,
                          ),
                      ]
                    : []),
                this.copied(),
            );
        }

        isOn(effect) {
            return this.model.parameters.some(
                (it, k) => it.effect === effect && it.switch !== null && this.values[k] !== 0,
            );
        }

        effect(name) {
            const { model } = this,
                own = model.parameters.filter((it) => it.effect === name);
            const inside = make("div", { className: "live-own" });
            const show = () =>
                inside.replaceChildren(
                    ...(this.isOn(name) ? own.map((it) => this.slider(it)) : []),
                );
            const box = make("input", {
                type: "checkbox",
                checked: this.isOn(name),
                onchange: () => {
                    for (const it of own.filter((one) => one.switch !== null)) {
                        const found = Object.values(model.sets).at(-1)[model.place.get(it.name)];
                        this.values[model.place.get(it.name)] = box.checked
                            ? found || it.switch
                            : 0;
                    }
                    show();
                    this.update();
                },
            });
            show();
            const label = make(
                "label",
                { className: "live-effect", title: model.effects[name] },
                box,
                " ",
                name.replaceAll("_", " "),
            );
            return make("div", { className: "live-group" }, label, inside);
        }

        slider(it) {
            const place = this.model.place.get(it.name),
                value = this.values[place];
            let [low, high] = [Math.min(it.slider[0], value), Math.max(it.slider[1], value)];
            const inverse = low > 0 && high / low > DECADES;
            const to = (x) =>
                inverse ? Math.log(x / low) / Math.log(high / low) : (x - low) / (high - low || 1);
            const back = (share) =>
                inverse ? low * (high / low) ** share : low + share * (high - low);
            const id = `${this.id}-${it.name}`,
                text = it.name.slice(it.effect ? it.name.indexOf(".") + 1 : 0).replaceAll("_", " ");
            const unit = it.unit === "1" ? "" : it.unit;
            const range = make("input", {
                type: "range",
                min: 0,
                max: STEPS,
                step: "any",
                value: STEPS * to(value),
                "aria-label": `${text}${unit && `, ${unit}`}`,
                oninput: () => set(back(range.valueAsNumber / STEPS), typed),
            });
            range.setAttribute("aria-valuetext", `${number(it.scale * value)} ${unit}`);
            const typed = make("input", {
                type: "number",
                id,
                step: "any",
                value: number(it.scale * value, 5),
                onchange: () => {
                    const asked = typed.valueAsNumber / it.scale;
                    if (!Number.isFinite(asked)) return;
                    const kept = Math.min(
                        Math.max(asked, it.low ?? -Infinity),
                        it.high ?? Infinity,
                    );
                    [low, high] = [Math.min(low, kept), Math.max(high, kept)];
                    if (kept !== asked) typed.value = number(it.scale * kept, 5);
                    set(kept, range);
                },
            });
            const set = (asked, other) => {
                this.values[place] = asked;
                if (other === typed) typed.value = number(it.scale * asked, 5);
                else range.value = STEPS * to(asked);
                range.setAttribute("aria-valuetext", `${number(it.scale * asked)} ${unit}`);
                this.update();
            };
            const error = it.error === null ? "" : ` ± ${number(it.scale * it.error, 2)}`;
            return make(
                "div",
                { className: "live-slider", title: it.about },
                make("label", { htmlFor: id }, text),
                range,
                make(
                    "span",
                    { className: "live-typed" },
                    typed,
                    make("span", { className: "live-unit" }, `${unit}${error}`),
                ),
            );
        }

        /* What drives a model without a log. */
        drives() {
            const { model, drive } = this,
                held = model.inputs
                    .map((it, k) => [it, k])
                    .filter(([it]) => it.name !== model.driven[0]);
            const again = () => {
                this.run = driven(model, drive);
                this.update();
            };
            const row = (text, unit, value, least, most, changed) => {
                const shown = make(
                    "span",
                    { className: "live-unit" },
                    `${number(value, 3)} ${unit}`,
                );
                const range = make("input", {
                    type: "range",
                    min: least,
                    max: most,
                    step: "any",
                    value,
                    "aria-label": text,
                    oninput: () => {
                        changed(range.valueAsNumber);
                        shown.textContent = `${number(range.valueAsNumber, 3)} ${unit}`;
                        again();
                    },
                });
                return make(
                    "div",
                    { className: "live-slider" },
                    make("label", {}, text),
                    range,
                    shown,
                );
            };
            const input = model.inputs.find((it) => it.name === model.driven[0]),
                { scale } = input;
            const shape = make(
                "select",
                {
                    "aria-label": "shape",
                    onchange: () => {
                        drive.shape = shape.value;
                        again();
                    },
                },
                ...SHAPES.map((it) => make("option", {}, it)),
            );
            shape.value = drive.shape;
            return make(
                "div",
                { className: "live-group" },
                make(
                    "label",
                    { className: "live-pick" },
                    make("span", {}, input.name.replaceAll("_", " ")),
                    shape,
                ),
                row(
                    "size",
                    input.unit,
                    scale * drive.size,
                    -2 * scale * Math.abs(model.driven[1]),
                    2 * scale * Math.abs(model.driven[1]),
                    (it) => {
                        drive.size = it / scale;
                    },
                ),
                row(
                    "frequency",
                    "Hz",
                    drive.rate,
                    0.2 / model.duration,
                    20 / model.duration,
                    (it) => {
                        drive.rate = it;
                    },
                ),
                ...held.map(([it, k]) => {
                    const reach = Number.isFinite(it.reach) ? it.reach : 1;
                    return row(
                        it.name.replaceAll("_", " "),
                        it.unit,
                        it.scale * drive.held[k],
                        it.scale * (it.low ?? it.rest - reach),
                        it.scale * (it.high ?? it.rest + reach),
                        (now) => {
                            drive.held[k] = now / it.scale;
                        },
                    );
                }),
            );
        }

        copied() {
            const said = make("span", { className: "live-said", role: "status" });
            const changed = () => {
                const { model } = this,
                    [nominal] = Object.values(model.sets);
                const lines = model.parameters
                    .filter((it, k) => this.values[k] !== nominal[k])
                    .map((it) => `    "${it.name}": ${this.values[model.place.get(it.name)]},`);
                return `sm.model(${JSON.stringify(model.actuator)}, ${JSON.stringify(model.variant)}${lines.length ? `, {\n${lines.join("\n")}\n}` : ""})`;
            };
            const copy = async () => {
                try {
                    await navigator.clipboard.writeText(changed());
                    said.textContent = "copied";
                } catch {
                    said.textContent = "not allowed here";
                }
            };
            return make(
                "p",
                { className: "live-copy" },
                make("button", { type: "button", onclick: copy }, "copy as Python"),
                " ",
                make(
                    "button",
                    { type: "button", onclick: () => this.saved() },
                    "save curves as CSV",
                ),
                " ",
                said,
            );
        }

        saved() {
            const { run, model, output, measured } = this,
                quoted = (text) => `"${text.replaceAll('"', '""')}"`;
            const names = [
                "time [s]",
                ...model.inputs.map((it) => it.name),
                ...(measured ? [`${output.name} ${this.given.beside}`] : []),
                `${output.name} nominal`,
                `${output.name} simulated`,
            ];
            const width = model.inputs.length,
                rows = [names.map(quoted).join(",")];
            run.stamps.forEach((stamp, k) => {
                const inputs = run.inputs.subarray(k * width, (k + 1) * width);
                rows.push(
                    [
                        stamp,
                        ...inputs,
                        ...(measured ? [measured[k]] : []),
                        this.base[k],
                        this.now[k],
                    ].join(","),
                );
            });
            const href = URL.createObjectURL(
                new Blob([rows.join("\n"), "\n"], { type: "text/csv" }),
            );
            make("a", { href, download: "curves.csv" }).click();
            setTimeout(() => URL.revokeObjectURL(href), 1000);
        }
    }

    document.documentElement.classList.add("lively");
    inflated(document.getElementById("live-data").textContent)
        .json()
        .then((panels) => {
            for (const place of document.querySelectorAll("[data-live]"))
                new Panel(place, panels[Number(place.dataset.live)]);
        });
})();
