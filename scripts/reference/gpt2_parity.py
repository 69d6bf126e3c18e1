"""A small GPT-2 of the transformers library: logits, gradients and ten training losses, in crates/train/tests/golden/gpt2_parity.json.

pip install torch transformers; python scripts/reference/gpt2_parity.py
Tensors are little-endian f32 in hexadecimal, matrices (in, out), under kinelm's names.
"""
import json
import math
from pathlib import Path

import torch
import transformers
from transformers import GPT2Config, GPT2LMHeadModel

SEED, LAYERS, HEADS, WIDTH, CONTEXT, VOCABULARY, BATCH, PAD = 20, 2, 2, 8, 12, 23, 3, 0
STEPS, RATE, WARMUP, FINAL, BETAS, DECAY, CLIP = 10, 2e-2, 3, 0.1, (0.9, 0.95), 0.1, 1.0

torch.manual_seed(SEED)
torch.set_num_threads(1)
config = GPT2Config(
    vocab_size=VOCABULARY, n_positions=CONTEXT, n_embd=WIDTH, n_layer=LAYERS, n_head=HEADS,
    activation_function="gelu_new", layer_norm_epsilon=1e-5, attn_implementation="eager",
    resid_pdrop=0.0, embd_pdrop=0.0, attn_pdrop=0.0, bos_token_id=1, eos_token_id=2,
)
model = GPT2LMHeadModel(config)
with torch.no_grad():  # away from zeros and ones, so that every part counts
    for p in model.parameters():
        p.add_(torch.randn_like(p) * 0.2)


def our_name(name):
    name = name.removeprefix("transformer.")
    for theirs, ours in [
        ("wte.", "token."), ("wpe.", "position.absolute."), ("h.0.", "block.00."), ("h.1.", "block.01."),
        ("ln_1.", "norm1."), ("ln_2.", "norm2."), ("ln_f.", "norm."), ("attn.c_attn.", "attention.qkv."),
        ("attn.c_proj.", "attention.out."), ("mlp.c_fc.", "mlp.up."), ("mlp.c_proj.", "mlp.down."),
    ]:
        name = name.replace(theirs, ours)
    return name


def pack(t):
    return {"shape": list(t.shape), "f32": t.detach().contiguous().numpy().astype("<f4").tobytes().hex()}


def loss_of(inputs, targets):
    logits = model(inputs).logits
    flat = torch.nn.functional.cross_entropy(logits.flatten(0, 1), targets.flatten(), ignore_index=PAD)
    return logits, flat


inputs = torch.randint(1, VOCABULARY, (BATCH, CONTEXT))
targets = torch.randint(1, VOCABULARY, (BATCH, CONTEXT))
targets[-1, -5:] = PAD
named = {our_name(n): p for n, p in model.named_parameters()}
weights = {n: pack(p) for n, p in sorted(named.items())}
logits, loss = loss_of(inputs, targets)
loss.backward()
gradients = {n: pack(p.grad) for n, p in sorted(named.items())}
embedding = ("token.", "position.")
decays = [p for n, p in named.items() if p.dim() == 2 and not n.startswith(embedding)]
others = [p for n, p in named.items() if p.dim() != 2 or n.startswith(embedding)]
groups = [{"params": decays, "weight_decay": DECAY}, {"params": others, "weight_decay": 0.0}]
optimizer = torch.optim.AdamW(groups, lr=RATE, betas=BETAS, eps=1e-8)
losses = []
for step in range(STEPS):
    rate = RATE * (step + 1) / WARMUP
    if step >= WARMUP:
        done = (step - WARMUP) / (STEPS - WARMUP - 1)
        rate = RATE * (FINAL + (1 - FINAL) * 0.5 * (1 + math.cos(math.pi * done)))
    for group in optimizer.param_groups:
        group["lr"] = rate
    optimizer.zero_grad()
    _, step_loss = loss_of(inputs, targets)
    step_loss.backward()
    torch.nn.utils.clip_grad_norm_(model.parameters(), CLIP)
    optimizer.step()
    losses.append(step_loss.item())

golden = {
    "script": "scripts/reference/gpt2_parity.py",
    "versions": {"torch": torch.__version__, "transformers": transformers.__version__},
    "seed": SEED,
    "model": {"layers": LAYERS, "heads": HEADS, "width": WIDTH, "context": CONTEXT, "vocabulary": VOCABULARY},
    "train": {"steps": STEPS, "rate": RATE, "warmup": WARMUP, "final": FINAL, "betas": BETAS, "decay": DECAY, "clip": CLIP},
    "inputs": inputs.flatten().tolist(),
    "targets": targets.flatten().tolist(),
    "loss": loss.item(),
    "losses": losses,
    "logits": pack(logits),
    "weights": weights,
    "gradients": gradients,
}
path = Path(__file__).resolve().parents[2] / "crates/train/tests/golden/gpt2_parity.json"
path.write_text(json.dumps(golden, indent=1) + "\n")
