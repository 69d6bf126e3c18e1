"""Folders of models: what `kinelm export` writes and `kinelm import` reads, run folders, and GPT-2's for transformers."""
import json
import os
import shutil
import tomllib
from pathlib import Path

import torch
from safetensors.torch import load_file, save

from model import Tokens, build, config_of

SCHEMA = 2


class Model:
    """A model's description, and where its weights are."""

    def __init__(self, config, tokens, conditions, tokenizer, weights, step, kinelm):
        self.config, self.tokens, self.conditions = config, tokens, conditions
        self.tokenizer, self.weights, self.step, self.kinelm = tokenizer, weights, step, kinelm

    @staticmethod
    def read(folder):
        """An exported folder, or a run with its best checkpoint (its latest where nothing was measured)."""
        folder = Path(folder)
        tokenizer = text_of(folder / "tokenizer.json", "a folder that `kinelm export --format kinelm` wrote, or a run")
        if (folder / "kinelm.json").exists():
            about = json.loads((folder / "kinelm.json").read_text())
            if about["schema"] != SCHEMA:
                raise SystemExit(f"{folder}/kinelm.json: found schema {about['schema']}; expected {SCHEMA}")
            weights, step, conditions = folder / "model.safetensors", about["step"], about["conditions"]
            version = about["kinelm"]
        else:
            about = tomllib.loads(text_of(folder / "config.toml", "kinelm.json, or the config.toml of a run"))
            name = next((folder / n).read_text().strip() for n in ("best", "latest") if (folder / n).exists())
            weights = folder / "checkpoints" / name / "model.safetensors"
            version = json.loads((folder / "provenance.json").read_text())["calls"][-1]["kinelm"]
            step, conditions = int(name.removeprefix("step-")), about["train"].get("conditions", [])
        tokens = Tokens(**about["tokens"])
        try:
            config = config_of(about["model"]).resolved(tokens)
        except ValueError as e:
            raise SystemExit(f"{folder}: {e}")
        return Model(config, tokens, conditions, tokenizer, weights, step, version)

    def build(self):
        """The model with its weights, on the CPU."""
        model = build(self.config, self.tokens)
        model.load_state_dict({name: x.float() for name, x in load_file(self.weights).items()})
        return model

    def forecast(self):
        """The tensors that no training changes."""
        return {name: x.float() for name, x in load_file(self.weights).items() if name.startswith("forecast.")}

    def write(self, folder, model, step):
        """What `kinelm import` reads; each file whole or not at all, the weights last."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        hash = json.loads(self.tokenizer)["decoder"]["kinelm"]["sha256"]
        about = {"schema": SCHEMA, "kinelm": self.kinelm, "model": model.config.stated(), "tokens": stated(self.tokens),
                 "conditions": self.conditions, "tokenizer_sha256": hash, "step": step}
        write_whole(folder / "tokenizer.json", self.tokenizer.encode())
        write_whole(folder / "kinelm.json", (json.dumps(about, indent=2) + "\n").encode())
        write_whole(folder / "model.safetensors", save(weights_of(model)))

    def write_hf(self, folder, model, step):
        """A folder that transformers loads as GPT2LMHeadModel, and kinelm imports too."""
        c, t, w = model.config, self.tokens, weights_of(model)
        self.refuse_for_gpt2(c)
        wpe = w.get("position.absolute.weight")
        if wpe is None:  # the front, then every place its frame's row and its place's
            k = torch.arange(c.context - t.front)
            behind = w["position.frame.weight"][k // t.word] + w["position.place.weight"][k % t.word]
            wpe = torch.cat([w["position.front.weight"], behind])
        names = {
            "token.weight": "wte.weight", "norm.": "ln_f.", "block.": "h.", "norm1.": "ln_1.", "norm2.": "ln_2.",
            "attention.qkv.": "attn.c_attn.", "attention.out.": "attn.c_proj.", "mlp.up.": "mlp.c_fc.",
            "mlp.down.": "mlp.c_proj.",
        }
        out = {"transformer.wpe.weight": wpe} | ({} if c.tied_head else {"lm_head.weight": w["head.weight"]})
        for name, x in w.items():
            if name.startswith(("token.", "norm.", "block.")):
                if name.startswith("block."):
                    name = f"block.{int(name[6:8])}{name[8:]}"
                for ours, theirs in names.items():
                    name = name.replace(ours, theirs)
                out["transformer." + name] = x
        config = {
            "architectures": ["GPT2LMHeadModel"], "model_type": "gpt2", "activation_function": "gelu_new",
            "vocab_size": t.vocabulary, "n_positions": c.context, "n_embd": c.width, "n_layer": c.layers, "n_head": c.heads,
            "layer_norm_epsilon": 1e-5, "resid_pdrop": c.dropout, "embd_pdrop": c.dropout, "attn_pdrop": c.dropout,
            "tie_word_embeddings": c.tied_head, "bos_token_id": t.bos, "eos_token_id": 2, "pad_token_id": t.pad,
        }
        special = {f"{name}_token": f"<{name}>" for name in ("bos", "eos", "unk", "pad", "mask")}
        kind = {"tokenizer_class": "PreTrainedTokenizerFast", "model_max_length": c.context, **special}
        self.write(folder, model, step)
        for name, content in [("config.json", config), ("tokenizer_config.json", kind)]:
            write_whole(Path(folder) / name, (json.dumps(content, indent=2) + "\n").encode())
        write_whole(Path(folder) / "model.safetensors", save(out, {"format": "pt"}))

    def refuse_for_gpt2(self, c):
        why = [reason for holds, reason in [
            (c.architecture != "flat", "it has two levels"), (c.kind != "causal", "it is masked"),
            (c.positions == "rope", "its positions are rope"),
            (c.previous_frame, "it reads the previous frame"), (c.head != "absolute", "its head is relative"),
            (c.positions == "frame_joint" and self.tokens.varying, "its words differ in length"),
        ] if holds]
        if why:
            raise SystemExit(f"GPT-2 can't express this model: {', '.join(why)}; leave --hf out")


def weights_of(model):
    """Parameters, and the forecast, which isn't trained."""
    return {name: p.detach().cpu().float().contiguous() for name, p in sorted(model.state_dict().items())}


def stated(tokens):
    """TokenLayout as kinelm writes it: what says nothing is left out."""
    silent = {"varying": False, "front": 1, "places": []}
    return {key: value for key, value in vars(tokens).items() if silent.get(key) != value or key not in silent}


def text_of(path, wanted):
    try:
        return path.read_text()
    except OSError as e:
        raise SystemExit(f"{path}: {e.strerror.lower()}; expected {wanted}")


def write_whole(path, content):
    """Through a temporary name, so that a reader finds the old file or the new one."""
    beside = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    with open(beside, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)


class Checkpoints:
    """`checkpoints/step-N` with weights, moments and state; a name without `.tmp` is whole."""

    def __init__(self, out):
        self.folder = Path(out) / "checkpoints"

    def steps(self):
        found = self.folder.glob("step-*") if self.folder.exists() else []
        return sorted(int(p.name[5:]) for p in found if p.name[5:].isdigit())

    def at(self, step):
        return self.folder / f"step-{step:08}"

    def write(self, step, model, moments, state):
        beside = self.folder / f"step-{step:08}.tmp"
        shutil.rmtree(beside, ignore_errors=True)
        beside.mkdir(parents=True)
        write_whole(beside / "model.safetensors", save(weights_of(model)))
        write_whole(beside / "optimizer.safetensors", save(moments))
        write_whole(beside / "state.json", (json.dumps(state, indent=2) + "\n").encode())
        shutil.rmtree(self.at(step), ignore_errors=True)
        beside.replace(self.at(step))

    def read(self, step):
        folder = self.at(step)
        state = json.loads((folder / "state.json").read_text())
        return load_file(folder / "model.safetensors"), load_file(folder / "optimizer.safetensors"), state

    def prune(self, keep, best):
        for step in [] if keep == "all" else self.steps()[:-keep]:
            if step != best:
                shutil.rmtree(self.at(step))
